// Ends a Ceres solve between two steps. Private to server/optimize.
#pragma once

#include <stop_token>
#include <utility>

#include <ceres/iteration_callback.h>

namespace cairn {

class StopCallback final : public ceres::IterationCallback {
 public:
  explicit StopCallback(std::stop_token stop) : stop_(std::move(stop)) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary&) override {
    return stop_.stop_requested() ? ceres::SOLVER_TERMINATE_SUCCESSFULLY : ceres::SOLVER_CONTINUE;
  }

 private:
  std::stop_token stop_;
};

}  // namespace cairn
