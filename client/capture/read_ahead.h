// A frame source that works ahead on a thread of its own, so that decoding, rectifying or rendering
// does not count into tracking time.
#pragma once

#include <functional>
#include <optional>
#include <thread>
#include <variant>

#include "client/capture/frame_source.h"
#include "common/util/bounded_queue.h"

namespace cairn {

struct Skipped {
  std::string why;  // one line that names the file
};
struct EndOfFrames {};
// What making the next frame came to.
using Produced = std::variant<Frame, Skipped, EndOfFrames>;

class ReadAhead final : public FrameSource {
 public:
  using Producer = std::function<Produced()>;

  // `produce` is called from the reading thread only, until it gives EndOfFrames. At most
  // kFramesAhead frames wait. `name` is for messages.
  ReadAhead(std::string name, CameraConfig camera, std::optional<std::uint64_t> size,
            Producer produce);

  const CameraConfig& camera() const override { return camera_; }
  // An error when the source ends without a single usable frame.
  Result<std::optional<Frame>> next() override;
  // Counts the frames skipped before the one that next() gave last.
  std::uint64_t skipped() const override { return skipped_; }
  std::optional<std::uint64_t> size() const override { return size_; }
  bool is_live() const override { return false; }

 private:
  static constexpr std::size_t kFramesAhead = 4;

  struct Item {
    std::optional<Frame> frame;  // nothing: the end
    std::uint64_t skipped = 0;   // so far
    std::string first_skip;
  };

  void read(std::stop_token stop);

  std::string name_;
  CameraConfig camera_;
  std::optional<std::uint64_t> size_;
  Producer produce_;
  std::uint64_t skipped_ = 0, delivered_ = 0;
  bool ended_ = false;
  BoundedQueue<Item> queue_{kFramesAhead};
  std::jthread thread_;  // last: ends before what it uses
};

}  // namespace cairn
