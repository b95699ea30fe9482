#include "server/http/status_server.h"

#include <gtest/gtest.h>
#include <httplib.h>

namespace cairn {
namespace {

StatusPages pages() {
  return {[] { return std::string("{\"clients\":2}"); }, [] { return std::string("cairn_x 1\n"); }};
}

TEST(StatusServer, ServesItsThreePages) {
  auto server = StatusServer::start("127.0.0.1:0", pages());
  ASSERT_TRUE(server.ok()) << server.message();
  httplib::Client client("127.0.0.1", (*server)->port());
  EXPECT_EQ(client.Get("/healthz")->body, "ok\n");
  EXPECT_EQ(client.Get("/status")->body, "{\"clients\":2}");
  EXPECT_EQ(client.Get("/metrics")->body, "cairn_x 1\n");
  EXPECT_EQ(client.Get("/other")->status, 404);
}

TEST(StatusServer, SaysThatAPortIsOccupied) {
  auto first = StatusServer::start("127.0.0.1:0", pages());
  ASSERT_TRUE(first.ok());
  auto second = StatusServer::start("127.0.0.1:" + std::to_string((*first)->port()), pages());
  ASSERT_FALSE(second.ok());
  EXPECT_EQ(second.error().code, ErrorCode::kUnavailable);
  EXPECT_NE(second.message().find("in use"), std::string::npos);
}

TEST(StatusServer, RefusesWhatIsNoAddress) {
  for (const char* bad : {"", "8080", ":8080", "127.0.0.1:", "127.0.0.1:x", "127.0.0.1:70000"}) {
    auto server = StatusServer::start(bad, pages());
    ASSERT_FALSE(server.ok()) << bad;
    EXPECT_EQ(server.error().code, ErrorCode::kInvalidArgument) << bad;
  }
}

}  // namespace
}  // namespace cairn
