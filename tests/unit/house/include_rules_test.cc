// Keeps the include rules of the tree (ARCHITECTURE.md, "Include rules").
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include <gtest/gtest.h>

namespace cairn {
namespace {

namespace fs = std::filesystem;

struct Include {
  std::string file;    // "server/map/map.cc"
  std::string header;  // as written: "opencv2/core.hpp", "server/map/map.h"
};

bool is_source(const fs::path& path) {
  return path.extension() == ".cc" || path.extension() == ".h";
}

const std::vector<Include>& includes() {
  static const std::vector<Include> all = [] {
    std::vector<Include> found;
    const std::regex pattern(R"re(^\s*#\s*include\s*["<]([^">]+)[">])re");
    const fs::path root(CAIRN_SOURCE_DIR);
    for (const char* top : {"common", "client", "server", "tests"}) {
      for (const auto& entry : fs::recursive_directory_iterator(root / top)) {
        if (!is_source(entry.path())) continue;
        std::ifstream in(entry.path());
        std::smatch match;
        for (std::string line; std::getline(in, line);)
          if (std::regex_search(line, match, pattern))
            found.push_back({fs::relative(entry.path(), root).generic_string(), match[1]});
      }
    }
    return found;
  }();
  return all;
}

bool starts(const std::string& text, std::initializer_list<const char*> prefixes) {
  for (const char* prefix : prefixes)
    if (text.starts_with(prefix)) return true;
  return false;
}

// Every include of a header that `matches` must stand in a file that `may`. Tests are free.
void expect_only_in(const char* what, const std::function<bool(const std::string&)>& matches,
                    const std::function<bool(const std::string&)>& may) {
  for (const Include& include : includes()) {
    if (include.file.starts_with("tests/unit/")) continue;
    if (matches(include.header) && !may(include.file)) {
      ADD_FAILURE() << include.file << " includes " << include.header << "; " << what;
    }
  }
}
auto header_in(std::initializer_list<const char*> prefixes) {
  return [list = std::vector<std::string>(prefixes.begin(), prefixes.end())](const std::string& h) {
    for (const auto& prefix : list)
      if (h.starts_with(prefix)) return true;
    return false;
  };
}

std::set<std::string> idl_headers() {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(fs::path(CAIRN_SOURCE_DIR) / "idl"))
    if (entry.path().extension() == ".idl") names.insert(entry.path().stem().string() + ".h");
  return names;
}

// "server/map" of "server/map/map.h"; "server" of "server/main.cc".
std::string folder_of(const std::string& path) {
  return fs::path(path).parent_path().string();
}

TEST(IncludeRules, TheTreeIsThere) {
  // Without this a wrong path would pass every other test.
  EXPECT_GT(includes().size(), 100u);
}

TEST(IncludeRules, DdsStaysInItsLayer) {
  expect_only_in("only common/dds/*.cc may", header_in({"dds/"}), [](const std::string& file) {
    return file.starts_with("common/dds/") && file.ends_with(".cc");
  });
}

TEST(IncludeRules, GeneratedTypesStayBelowTheWire) {
  const auto generated = idl_headers();
  ASSERT_FALSE(generated.empty());
  expect_only_in(
      "only sources of common/dds and common/wire may see generated types",
      [&](const std::string& header) { return generated.contains(header); },
      [](const std::string& file) {
        return starts(file, {"common/dds/", "common/wire/"}) && file.ends_with(".cc");
      });
}

TEST(IncludeRules, CeresStaysInServerOptimize) {
  expect_only_in("only server/optimize may", header_in({"ceres/"}), [](const std::string& file) {
    return file.starts_with("server/optimize/") || file == "client/tracking/pose_solver.cc";
  });
  for (const Include& include : includes())
    if (include.file == "client/tracking/pose_solver.cc" && include.header.starts_with("ceres/")) {
      EXPECT_EQ(include.header, "ceres/tiny_solver.h");
    }
}

TEST(IncludeRules, FlannStaysInServerPlace) {
  expect_only_in("only server/place and its benchmark may", header_in({"flann/", "opencv2/flann"}),
                 [](const std::string& file) {
                   return starts(file, {"server/place/", "tests/bench/place/"});
                 });
}

TEST(IncludeRules, SqliteStaysInStorageAndOutbox) {
  expect_only_in("only server/storage and client/link/outbox.cc may", header_in({"sqlite3"}),
                 [](const std::string& file) {
                   return file.starts_with("server/storage/") || file == "client/link/outbox.cc";
                 });
}

TEST(IncludeRules, ValuesAndTheMapKnowNoOpenCv) {
  expect_only_in("common/model, common/geometry and server/map may not", header_in({"opencv2/"}),
                 [](const std::string& file) {
                   return !starts(file, {"common/model/", "common/geometry/", "server/map/"});
                 });
}

TEST(IncludeRules, YamlStaysOutOfHeaders) {
  expect_only_in("only .cc files may", header_in({"yaml-cpp/"}),
                 [](const std::string& file) { return file.ends_with(".cc"); });
}

TEST(IncludeRules, ClientServerAndCommonKeepApart) {
  expect_only_in("client may not include server", header_in({"server/"}),
                 [](const std::string& file) {
                   return !starts(file, {"client/", "common/"});
                 });
  expect_only_in("server may not include client", header_in({"client/"}),
                 [](const std::string& file) {
                   return !starts(file, {"server/", "common/"});
                 });
}

TEST(IncludeRules, OnlyTestsAndTheSyntheticSourceSeeTestSupport) {
  expect_only_in("product code may not lean on tests", header_in({"tests/"}),
                 [](const std::string& file) {
                   return starts(file, {"tests/", "client/capture/", "server/tool/"});
                 });
}

TEST(IncludeRules, FoldersMakeNoCycles) {
  std::map<std::string, std::set<std::string>> uses;
  for (const Include& include : includes()) {
    if (!starts(include.header, {"common/", "client/", "server/"})) continue;
    const std::string from = folder_of(include.file), to = folder_of(include.header);
    if (from != to && !from.starts_with("tests")) uses[from].insert(to);
  }
  // Depth first; a folder that is met again while it is still open closes a cycle.
  std::set<std::string> done;
  std::vector<std::string> open;
  std::function<void(const std::string&)> visit = [&](const std::string& folder) {
    const auto again = std::find(open.begin(), open.end(), folder);
    if (again != open.end()) {
      std::string cycle;
      for (auto it = again; it != open.end(); ++it) cycle += *it + " -> ";
      ADD_FAILURE() << "folders include each other: " << cycle << folder;
      return;
    }
    if (done.contains(folder)) return;
    open.push_back(folder);
    for (const auto& next : uses[folder]) visit(next);
    open.pop_back();
    done.insert(folder);
  };
  const auto roots = uses;
  for (const auto& [folder, ignored] : roots) visit(folder);
}

TEST(HeaderRules, EveryHeaderIsGuarded) {
  const fs::path root(CAIRN_SOURCE_DIR);
  for (const char* top : {"common", "client", "server", "tests"}) {
    for (const auto& entry : fs::recursive_directory_iterator(root / top)) {
      if (entry.path().extension() != ".h") continue;
      std::ifstream in(entry.path());
      const std::string text((std::istreambuf_iterator<char>(in)), {});
      EXPECT_NE(text.find("#pragma once"), text.npos) << entry.path();
      EXPECT_EQ(text.find("using namespace"), text.npos) << entry.path();
    }
  }
}

}  // namespace
}  // namespace cairn
