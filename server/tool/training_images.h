// Descriptors to train a vocabulary on: of image files, and of the synthetic scenes.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "common/model/features.h"
#include "common/util/status.h"

namespace cairn {

using ImageDescriptors = std::vector<std::vector<Descriptor>>;  // one list an image
using Progress = std::function<void(std::size_t done, std::size_t total)>;

// Image files (jpg, jpeg, png, pgm, bmp, tif, tiff) in the folders and below them, each folder's in
// order of their names. Errors: kNotFound for a folder that can't be read or has no images.
Result<std::vector<std::string>> images_in(const std::vector<std::string>& folders);

// At most `features` of each file. Errors: kCorrupt for a file that is no image.
Result<ImageDescriptors> describe_images(const std::vector<std::string>& files, int features,
                                         const Progress& progress = {});

// `frames` images spread along a way through each scene, with the sensor's noise. Errors: unknown
// scene.
Result<ImageDescriptors> describe_scenes(const std::vector<std::string>& scenes, int frames,
                                         std::uint64_t seed, int features,
                                         const Progress& progress = {});

}  // namespace cairn
