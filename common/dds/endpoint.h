// Writers and readers of IDL samples, untyped: a sample is a pointer to the struct that idlc has
// generated for the topic. common/wire/topics.h makes typed ones of them; use those.
#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <memory>
#include <string>

#include "common/dds/participant.h"
#include "common/dds/qos.h"

namespace cairn::dds {

struct TopicType {
  const char* name;        // of the topic, with the version of the protocol
  const void* descriptor;  // the dds_topic_descriptor_t that idlc has generated
  Quality quality;
};

// Safe from any thread.
class SampleWriter {
 public:
  static Result<SampleWriter> create(std::shared_ptr<Participant> participant,
                                     const TopicType& topic, const std::string& partition);

  // kTimeout (kStream only): no room, the sample was not taken; write it again.
  Status write(const void* sample);
  // Waits until the readers of now have all that was written. kTimeout when they don't in time.
  Status flush(std::chrono::nanoseconds timeout);
  int matched_readers() const;

 private:
  std::shared_ptr<Participant> participant_;
  Entity publisher_, topic_, writer_;
  const char* name_ = "";
};

// For one thread at a time.
class SampleReader {
 public:
  static Result<SampleReader> create(std::shared_ptr<Participant> participant,
                                     const TopicType& topic, const std::string& partition);

  // Takes what has arrived and calls `on_sample` for each, oldest first within an instance. The
  // sample is lent until the call returns. Returns how many there were.
  Result<std::size_t> take(const std::function<void(const void*)>& on_sample);
  // Triggered while there is something to take; for WaitLoop.
  std::int32_t condition() const { return condition_.handle(); }
  int matched_writers() const;

 private:
  std::shared_ptr<Participant> participant_;
  // Destroyed in reverse: the condition before its reader.
  Entity subscriber_, topic_, reader_, condition_;
  const char* name_ = "";
};

}  // namespace cairn::dds
