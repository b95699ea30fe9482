#include "common/dds/endpoint.h"

#include <array>

#include <dds/dds.h>

namespace cairn::dds {
namespace {

// Samples lent at once. Bounded so that a burst of large keyframes is handled bit by bit.
constexpr std::size_t kBatch = 16;

Result<Entity> make_topic(const Participant& participant, const TopicType& type) {
  const auto* descriptor = static_cast<const dds_topic_descriptor_t*>(type.descriptor);
  return own(std::string("DDS topic ") + type.name,
             dds_create_topic(participant.handle(), descriptor, type.name, nullptr, nullptr));
}

// Gives the loan back whatever happens in between.
class Loan {
 public:
  Loan(dds_entity_t reader, void** samples, std::int32_t count)
      : reader_(reader), samples_(samples), count_(count) {}
  ~Loan() { (void)dds_return_loan(reader_, samples_, count_); }
  Loan(const Loan&) = delete;
  Loan& operator=(const Loan&) = delete;

 private:
  dds_entity_t reader_;
  void** samples_;
  std::int32_t count_;
};

}  // namespace

Result<SampleWriter> SampleWriter::create(std::shared_ptr<Participant> participant,
                                          const TopicType& type, const std::string& partition) {
  const std::string what = std::string("DDS writer of ") + type.name;
  const QosPtr place = make_partition_qos(partition);
  const QosPtr quality = make_qos(type.quality);
  SampleWriter made;
  auto topic = make_topic(*participant, type);
  if (!topic) return topic.error();
  auto publisher = own(what, dds_create_publisher(participant->handle(), place.get(), nullptr));
  if (!publisher) return publisher.error();
  auto writer =
      own(what, dds_create_writer(publisher->handle(), topic->handle(), quality.get(), nullptr));
  if (!writer) return writer.error();
  made.participant_ = std::move(participant);
  made.publisher_ = std::move(*publisher);
  made.topic_ = std::move(*topic);
  made.writer_ = std::move(*writer);
  made.name_ = type.name;
  return made;
}

Status SampleWriter::write(const void* sample) {
  const dds_return_t rc = dds_write(writer_.handle(), sample);
  if (rc < 0) return dds_error(std::string("sending on ") + name_, rc);
  return {};
}

Status SampleWriter::flush(std::chrono::nanoseconds timeout) {
  const dds_return_t rc = dds_wait_for_acks(writer_.handle(), timeout.count());
  if (rc < 0) return dds_error(std::string("delivery on ") + name_, rc);
  return {};
}

int SampleWriter::matched_readers() const {
  dds_publication_matched_status_t status{};
  if (dds_get_publication_matched_status(writer_.handle(), &status) < 0) return 0;
  return static_cast<int>(status.current_count);
}

Result<SampleReader> SampleReader::create(std::shared_ptr<Participant> participant,
                                          const TopicType& type, const std::string& partition) {
  const std::string what = std::string("DDS reader of ") + type.name;
  const QosPtr place = make_partition_qos(partition);
  const QosPtr quality = make_qos(type.quality);
  SampleReader made;
  auto topic = make_topic(*participant, type);
  if (!topic) return topic.error();
  auto subscriber = own(what, dds_create_subscriber(participant->handle(), place.get(), nullptr));
  if (!subscriber) return subscriber.error();
  auto reader =
      own(what, dds_create_reader(subscriber->handle(), topic->handle(), quality.get(), nullptr));
  if (!reader) return reader.error();
  auto condition = own(what, dds_create_readcondition(reader->handle(), DDS_ANY_STATE));
  if (!condition) return condition.error();
  made.participant_ = std::move(participant);
  made.subscriber_ = std::move(*subscriber);
  made.topic_ = std::move(*topic);
  made.reader_ = std::move(*reader);
  made.condition_ = std::move(*condition);
  made.name_ = type.name;
  return made;
}

Result<std::size_t> SampleReader::take(const std::function<void(const void*)>& on_sample) {
  std::size_t taken = 0;
  while (true) {
    std::array<void*, kBatch> samples{};  // zeros ask for a loan
    std::array<dds_sample_info_t, kBatch> infos{};
    const dds_return_t count =
        dds_take(reader_.handle(), samples.data(), infos.data(), kBatch, kBatch);
    if (count < 0) return dds_error(std::string("receiving on ") + name_, count);
    if (count == 0) return taken;
    const Loan loan(reader_.handle(), samples.data(), count);
    for (dds_return_t i = 0; i < count; ++i) {
      // Without valid data a sample only tells that an instance has ended.
      if (!infos[static_cast<std::size_t>(i)].valid_data) continue;
      on_sample(samples[static_cast<std::size_t>(i)]);
      ++taken;
    }
  }
}

int SampleReader::matched_writers() const {
  dds_subscription_matched_status_t status{};
  if (dds_get_subscription_matched_status(reader_.handle(), &status) < 0) return 0;
  return static_cast<int>(status.current_count);
}

}  // namespace cairn::dds
