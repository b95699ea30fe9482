// How many bytes may go to a client: so many a second in the long run, and what was not used is
// saved for when more is needed at once, up to a limit.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

namespace cairn {

// The clock is that of the client's own stamps, so that a run that is repeated gets the same
// updates however fast it is played.
class ByteBudget {
 public:
  // Starts with all that can be saved.
  ByteBudget(double bytes_per_s, double most_saved)
      : bytes_per_s_(bytes_per_s), most_saved_(most_saved), available_(most_saved) {}

  // The client's time is at least this. Earlier stamps than known change nothing.
  void advance(std::int64_t stamp_ns);
  // Negative after more was spent than there was: what can't wait is sent all the same.
  double available() const { return available_; }
  void spend(std::size_t bytes) { available_ -= static_cast<double>(bytes); }

 private:
  double bytes_per_s_, most_saved_, available_;
  std::optional<std::int64_t> now_ns_;
};

}  // namespace cairn
