#include "server/http/status_server.h"

#include <charconv>
#include <thread>

#include <fmt/format.h>
#include <httplib.h>

namespace cairn {
namespace {

struct Address {
  std::string host;
  int port = 0;
};

Result<Address> parse_address(const std::string& text) {
  const std::size_t colon = text.rfind(':');
  Address address;
  if (colon != std::string::npos && colon > 0) {
    address.host = text.substr(0, colon);
    const char* begin = text.data() + colon + 1;
    const char* end = text.data() + text.size();
    const auto [last, error] = std::from_chars(begin, end, address.port);
    if (error == std::errc() && last == end && begin != end && address.port >= 0 &&
        address.port <= 65535)
      return address;
  }
  return Error{ErrorCode::kInvalidArgument,
               fmt::format("--http {}: not of the form ADDR:PORT, such as 127.0.0.1:8080", text)};
}

}  // namespace

struct StatusServer::Parts {
  httplib::Server server;
  int port = 0;
  std::jthread thread;
};

Result<std::unique_ptr<StatusServer>> StatusServer::start(const std::string& address,
                                                          const StatusPages& pages) {
  const Result<Address> parsed = parse_address(address);
  if (!parsed) return parsed.error();
  auto parts = std::make_unique<Parts>();
  httplib::Server& server = parts->server;
  // The library's default lets several servers share a port, so that a second one would start and
  // never be asked.
  server.set_socket_options([](socket_t) {});
  server.new_task_queue = [] { return new httplib::ThreadPool(2); };
  server.Get("/healthz", [](const httplib::Request&, httplib::Response& response) {
    response.set_content("ok\n", "text/plain");
  });
  server.Get("/status", [pages](const httplib::Request&, httplib::Response& response) {
    response.set_content(pages.status_json(), "application/json");
  });
  server.Get("/metrics", [pages](const httplib::Request&, httplib::Response& response) {
    response.set_content(pages.metrics_text(), "text/plain; version=0.0.4");
  });
  if (parsed->port == 0) {
    parts->port = server.bind_to_any_port(parsed->host);
  } else {
    parts->port = server.bind_to_port(parsed->host, parsed->port) ? parsed->port : -1;
  }
  if (parts->port <= 0)
    return Error{
        ErrorCode::kUnavailable,
        fmt::format("--http {}: can't listen there; is the port in use by another program, "
                    "or the address not this machine's?",
                    address)};
  parts->thread = std::jthread([&server] { server.listen_after_bind(); });
  // stop() before the loop has begun would be lost; it begins within microseconds.
  while (!server.is_running()) std::this_thread::yield();
  return std::unique_ptr<StatusServer>(new StatusServer(std::move(parts)));
}

StatusServer::StatusServer(std::unique_ptr<Parts> parts) : parts_(std::move(parts)) {}
StatusServer::~StatusServer() {
  parts_->server.stop();
}
int StatusServer::port() const {
  return parts_->port;
}

}  // namespace cairn
