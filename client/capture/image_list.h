// Lists of images: what a recording's text files say, and which images belong together.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/util/status.h"

namespace cairn {

struct ListedImage {
  std::int64_t stamp_ns = 0;
  std::filesystem::path file;
};

// Images of one moment; paths that don't apply are empty.
struct FrameFiles {
  std::int64_t stamp_ns = 0;
  std::filesystem::path gray, right, depth;
};

// Seconds as decimal text, exact to the nanosecond (a double is not, for today's time stamps).
// Exponents are understood too. Nothing for anything else, negative or absurdly large numbers.
std::optional<std::int64_t> parse_seconds(std::string_view text);
// Whole nanoseconds as text.
std::optional<std::int64_t> parse_nanoseconds(std::string_view text);

// How the lines of a list are written: "seconds path ..." as in TUM's rgb.txt, or
// "nanoseconds,path" as in EuRoC's data.csv. Comments (#), empty lines and further columns are
// passed over.
enum class ListFormat { kTum, kEuroc };

// Reads `file`; paths in it are relative to `base`. Lines that can't be read are logged and left
// out. Sorted by stamp. Error when the file is missing or no line is usable.
Result<std::vector<ListedImage>> read_image_list(const std::filesystem::path& file,
                                                 const std::filesystem::path& base,
                                                 ListFormat format);

// The image files (by extension) of a folder, by name. Error when it is missing or holds none.
Result<std::vector<std::filesystem::path>> list_images(const std::filesystem::path& folder);

// Pairs (index in `a`, index in `b`) of images at most `max_gap_ns` apart, one to one, the closest
// pairs first, as the TUM RGB-D benchmark's tools define it (Sturm et al. 2012). Ordered by `a`.
// Both lists must be sorted by stamp.
std::vector<std::pair<std::size_t, std::size_t>> associate(const std::vector<ListedImage>& a,
                                                           const std::vector<ListedImage>& b,
                                                           std::int64_t max_gap_ns);

}  // namespace cairn
