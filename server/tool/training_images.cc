#include "server/tool/training_images.h"

#include <algorithm>
#include <array>
#include <filesystem>

#include <opencv2/imgcodecs.hpp>

#include "common/feature/extract_features.h"
#include "tests/support/synthetic_sequence.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;

bool is_image(const fs::path& path) {
  static constexpr std::array kEndings = {".jpg", ".jpeg", ".png", ".pgm", ".bmp", ".tif", ".tiff"};
  std::string ending = path.extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return std::find(kEndings.begin(), kEndings.end(), ending) != kEndings.end();
}

}  // namespace

Result<std::vector<std::string>> images_in(const std::vector<std::string>& folders) {
  std::vector<std::string> files;
  for (const std::string& folder : folders) {
    std::vector<std::string> found;
    std::error_code error;
    for (fs::recursive_directory_iterator it(folder, error), end; !error && it != end;
         it.increment(error))
      if (it->is_regular_file() && is_image(it->path())) found.push_back(it->path().string());
    if (error) return {ErrorCode::kNotFound, "cannot read " + folder + ": " + error.message()};
    if (found.empty()) return {ErrorCode::kNotFound, folder + " has no images"};
    std::sort(found.begin(), found.end());
    files.insert(files.end(), found.begin(), found.end());
  }
  return files;
}

Result<ImageDescriptors> describe_images(const std::vector<std::string>& files, int features,
                                         const Progress& progress) {
  ImageDescriptors described;
  for (const std::string& file : files) {
    const cv::Mat gray = cv::imread(file, cv::IMREAD_GRAYSCALE);
    if (gray.empty()) return {ErrorCode::kCorrupt, file + ": not a readable image"};
    described.push_back(extract_features(gray, features).descriptors);
    if (progress) progress(described.size(), files.size());
  }
  return described;
}

Result<ImageDescriptors> describe_scenes(const std::vector<std::string>& scenes, int frames,
                                         std::uint64_t seed, int features,
                                         const Progress& progress) {
  ImageDescriptors described;
  for (const std::string& scene : scenes) {
    const auto sequence =
        synthetic::SyntheticSequence::make({.scene = scene, .seed = seed, .depth_noise = false});
    if (!sequence) return sequence.error();
    for (int i = 0; i < frames; ++i) {
      const auto frame = (*sequence)->frame(i * (*sequence)->size() / frames);
      described.push_back(extract_features(frame.gray, features).descriptors);
      if (progress) progress(described.size(), scenes.size() * static_cast<std::size_t>(frames));
    }
  }
  return described;
}

}  // namespace cairn
