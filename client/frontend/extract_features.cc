#include "common/feature/extract_features.h"

#include "client/frontend/extractor.h"

namespace cairn {

Features extract_features(const cv::Mat& gray, int count) {
  ExtractorOptions options;
  options.features = count;
  Features features;
  Extractor(options).extract(gray, features);
  return features;
}

}  // namespace cairn
