// The features of a single image, just as clients find them.
//
// For programs that have an image and no client: training a vocabulary, experiments. Declared here
// because the server's side wants it; defined in client/frontend (link cairn_frontend), whose
// Extractor is what works on streams.
#pragma once

#include "common/model/features.h"

namespace cv {
class Mat;
}

namespace cairn {

// Of a grey image (CV_8UC1) with the extractor's defaults, at most `count`; none when the image is
// empty or of another type. Positions are those in the image. Each call is on its own: E0 of the
// entropy step comes from this image alone. Any thread.
Features extract_features(const cv::Mat& gray, int count = 1000);

}  // namespace cairn
