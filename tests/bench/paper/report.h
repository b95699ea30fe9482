// The results page: Markdown, with pictures beside it.
#pragma once

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "tests/bench/paper/matching.h"
#include "tests/bench/paper/runs.h"

namespace cairn::bench {

double median(std::vector<double> values);  // NaN for none

// All matching results of one set of views, one a method.
struct MatchingTable {
  const ViewSet* set = nullptr;
  std::vector<Method> methods;
  std::vector<MatchingResult> results;
};

// All runs on one data set: runs[variant][run].
struct RunTable {
  DataSet set;
  std::vector<Variant> variants;
  std::vector<std::vector<RunResult>> runs;
  std::vector<Trajectory> truths;  // of each run
};

// Writes into `folder` (made if need be): README.md, pictures, runs.csv.
class Report {
 public:
  explicit Report(const std::filesystem::path& folder);

  void introduce(int runs, bool quick);
  void add_rotated_pairs(const std::vector<MatchingTable>& tables);
  void add_adjacent_frames(const std::vector<MatchingTable>& tables);
  void add_runs(const std::vector<RunTable>& tables);
  // What is asked of sharpening, and whether it holds. True when all does.
  bool add_verdict(const std::vector<MatchingTable>& pairs, const std::vector<RunTable>& runs);

 private:
  void picture(const std::string& name, const std::string& svg);
  void picture(const std::string& name, const cv::Mat& image);

  std::filesystem::path folder_;
  std::ofstream page_;
};

}  // namespace cairn::bench
