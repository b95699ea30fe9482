#include "common/util/thread.h"

#include <pthread.h>
#include <sys/resource.h>
#include <unistd.h>

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <thread>

namespace cairn {
namespace {

int niceness() {
  return getpriority(PRIO_PROCESS, static_cast<id_t>(gettid()));
}

TEST(Thread, GivesWayWithoutItsStarterDoingSo) {
  const int before = niceness();
  int inside = 0;
  std::jthread([&] {
    yield_to_others(3);
    inside = niceness();
  }).join();
  EXPECT_EQ(inside, std::min(before + 3, 19));
  EXPECT_EQ(niceness(), before);
}

TEST(Thread, HasTheNameThatItWasGiven) {
  std::string name(16, ' ');
  std::jthread([&] {
    name_this_thread("a name that is too long");
    pthread_getname_np(pthread_self(), name.data(), name.size());
  }).join();
  EXPECT_STREQ(name.c_str(), "a name that is ");
}

}  // namespace
}  // namespace cairn
