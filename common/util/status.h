// Errors as values. Functions that can fail for reasons outside the program return Status or
// Result<T>; exceptions of libraries are caught at the border and turned into these.
//
// A message is one line that a user understands: what failed, where, and what to do about it.
#pragma once

#include <cassert>
#include <optional>
#include <string>
#include <utility>
#include <variant>

namespace cairn {

enum class ErrorCode {
  kInvalidArgument,  // the caller or the user gave something unusable
  kNotFound,
  kCorrupt,      // data that contradicts its own format
  kVersion,      // data of a version that this program does not read
  kUnavailable,  // a resource or peer that may be there later
  kTimeout,
  kInternal,
};

struct Error {
  ErrorCode code = ErrorCode::kInternal;
  std::string message;
};

class [[nodiscard]] Status {
 public:
  Status() = default;
  Status(Error error) : error_(std::move(error)) {}
  Status(ErrorCode code, std::string message) : error_(Error{code, std::move(message)}) {}

  bool ok() const { return !error_.has_value(); }
  explicit operator bool() const { return ok(); }
  const Error& error() const { return *error_; }
  const std::string& message() const { return error_->message; }

 private:
  std::optional<Error> error_;
};

template <typename T>
class [[nodiscard]] Result {
 public:
  Result(T value) : value_(std::move(value)) {}
  Result(Error error) : value_(std::move(error)) {}
  Result(ErrorCode code, std::string message) : value_(Error{code, std::move(message)}) {}

  bool ok() const { return std::holds_alternative<T>(value_); }
  explicit operator bool() const { return ok(); }
  const Error& error() const { return std::get<Error>(value_); }
  const std::string& message() const { return error().message; }
  T& value() { return std::get<T>(value_); }
  const T& value() const { return std::get<T>(value_); }
  T& operator*() { return value(); }
  const T& operator*() const { return value(); }
  T* operator->() { return &value(); }
  const T* operator->() const { return &value(); }

 private:
  std::variant<T, Error> value_;
};

}  // namespace cairn
