// The server's state over HTTP, for people, scripts and Prometheus:
//   GET /healthz   200 "ok" while the server runs
//   GET /status    JSON
//   GET /metrics   Prometheus text format
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "common/util/status.h"

namespace cairn {

// Called from the HTTP threads, several at a time.
struct StatusPages {
  std::function<std::string()> status_json;
  std::function<std::string()> metrics_text;
};

class StatusServer {
 public:
  // `address` is ADDR:PORT, with port 0 for any free one. kInvalidArgument: no such form.
  // kUnavailable: the address can't be bound, as when another program listens there.
  static Result<std::unique_ptr<StatusServer>> start(const std::string& address,
                                                     const StatusPages& pages);
  ~StatusServer();  // stops listening and waits for requests under way
  StatusServer(const StatusServer&) = delete;
  StatusServer& operator=(const StatusServer&) = delete;

  int port() const;

 private:
  struct Parts;
  explicit StatusServer(std::unique_ptr<Parts> parts);
  std::unique_ptr<Parts> parts_;
};

}  // namespace cairn
