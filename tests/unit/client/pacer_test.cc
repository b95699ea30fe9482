#include "client/pacer.h"

#include <algorithm>
#include <condition_variable>
#include <mutex>
#include <thread>

#include <gtest/gtest.h>

namespace cairn {
namespace {

using std::chrono::milliseconds;

// Frames with stamps `period` apart, each of which takes `work` to make.
class TimedSource : public FrameSource {
 public:
  TimedSource(int frames, milliseconds period, milliseconds work)
      : frames_(frames), period_(period), work_(work) {}

  const CameraConfig& camera() const override { return camera_; }
  Result<std::optional<Frame>> next() override {
    if (made_ == frames_) return std::optional<Frame>();
    std::this_thread::sleep_for(work_);
    Frame frame;
    frame.stamp_ns = std::chrono::nanoseconds(period_).count() * made_++;
    return std::optional<Frame>(frame);
  }
  std::uint64_t skipped() const override { return 0; }
  std::optional<std::uint64_t> size() const override { return frames_; }
  bool is_live() const override { return false; }

 private:
  const int frames_;
  const milliseconds period_, work_;
  const CameraConfig camera_;
  int made_ = 0;
};

// Takes every frame that the pacer gives, busy with each for so long. Returns how many they were.
std::uint64_t play(Pacer& pacer, milliseconds busy) {
  std::uint64_t frames = 0;
  const auto wait = [](std::chrono::nanoseconds time) { std::this_thread::sleep_for(time); };
  for (;;) {
    const auto frame = pacer.next(wait, {});
    EXPECT_TRUE(frame.ok());
    if (!frame.ok() || !frame->has_value()) return frames;
    ++frames;
    std::this_thread::sleep_for(busy);
  }
}

TEST(Pacer, PlaysAtTheRecordingsOwnPace) {
  TimedSource source(6, milliseconds(20), milliseconds(0));
  Pacer pacer(source, true);
  const auto start = std::chrono::steady_clock::now();
  play(pacer, milliseconds(0));
  EXPECT_GE(std::chrono::steady_clock::now() - start, milliseconds(100));
}

TEST(Pacer, DropsAndCountsWhatABusyCallerMisses) {
  TimedSource source(40, milliseconds(5), milliseconds(0));
  Pacer pacer(source, true);
  const std::uint64_t frames = play(pacer, milliseconds(30));
  EXPECT_GE(pacer.dropped(), 10u);
  EXPECT_EQ(frames + pacer.dropped(), 40u);
}

// Most are, should this machine be too busy to call back in time.
TEST(Pacer, WaitsForASourceThatIsSlowerThanItsPace) {
  TimedSource source(20, milliseconds(20), milliseconds(40));
  Pacer pacer(source, true);
  EXPECT_GE(play(pacer, milliseconds(0)), 10u);
}

TEST(Pacer, DropsNothingWhenNotInRealTime) {
  TimedSource source(20, milliseconds(1), milliseconds(0));
  Pacer pacer(source, false);
  EXPECT_EQ(play(pacer, milliseconds(3)), 20u);
  EXPECT_EQ(pacer.dropped(), 0u);
}

TEST(Pacer, AStopEndsTheWaitForAFrameThatIsFarAway) {
  TimedSource source(3, std::chrono::hours(1), milliseconds(0));
  Pacer pacer(source, true);
  std::stop_source stop;
  std::mutex mutex;
  std::condition_variable_any never;
  int waits = 0;
  const auto wait = [&](std::chrono::nanoseconds time) {
    if (++waits == 2) stop.request_stop();
    std::unique_lock lock(mutex);
    never.wait_for(lock, stop.get_token(), std::min(time, std::chrono::nanoseconds(1000)),
                   [] { return false; });
  };
  ASSERT_TRUE(pacer.next(wait, stop.get_token())->has_value());
  EXPECT_EQ(waits, 0) << "the first one is due at once";
  const auto frame = pacer.next(wait, stop.get_token());
  ASSERT_TRUE(frame.ok());
  EXPECT_FALSE(frame->has_value());
  EXPECT_EQ(waits, 2);
}

}  // namespace
}  // namespace cairn
