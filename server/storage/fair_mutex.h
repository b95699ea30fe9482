// A mutex that lets in whoever came first. With a std::mutex a thread that lets go and locks again
// at once is nearly always first, and those who wait would wait for all of its work.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <mutex>

namespace cairn {

class FairMutex {
 public:
  void lock() {
    std::unique_lock lock(mutex_);
    const std::uint64_t ticket = next_++;
    turn_.wait(lock, [&] { return serving_ == ticket; });
  }
  void unlock() {
    {
      const std::lock_guard lock(mutex_);
      ++serving_;
    }
    turn_.notify_all();
  }

 private:
  std::mutex mutex_;
  std::condition_variable turn_;
  std::uint64_t next_ = 0, serving_ = 0;
};

}  // namespace cairn
