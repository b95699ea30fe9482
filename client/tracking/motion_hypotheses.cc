#include "client/tracking/motion_hypotheses.h"

#include <algorithm>

#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>

#include "common/util/log.h"

namespace cairn {
namespace {

constexpr double kPixels = 2.0;        // from the model; coarse octaves are no better
constexpr double kLeastMotion = 1e-3;  // of a homography's translation, in distances of the plane

cv::UsacParams usac(int seed) {
  cv::UsacParams params;
  params.confidence = 0.999;
  params.maxIterations = 1000;
  params.threshold = kPixels;
  params.isParallel = false;
  params.randomGeneratorState = seed;
  params.sampler = cv::SAMPLING_UNIFORM;
  params.score = cv::SCORE_METHOD_MSAC;
  params.loMethod = cv::LOCAL_OPTIM_INNER_LO;
  return params;
}

Rigid3 motion_of(const cv::Mat& rotation, const cv::Mat& translation) {
  Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) m(row, column) = rotation.at<double>(row, column);
    m(row, 3) = translation.at<double>(row);
  }
  Rigid3 motion = Rigid3::from_matrix(m);
  motion.translation.normalize();
  return motion;
}

void add_from_essential(const std::vector<cv::Point2d>& a, const std::vector<cv::Point2d>& b,
                        const cv::Matx33d& k, std::vector<Rigid3>& motions) {
  cv::Mat mask;
  const cv::Mat essential =
      cv::findEssentialMat(a, b, k, k, cv::noArray(), cv::noArray(), mask, usac(1));
  if (essential.rows != 3 || essential.cols != 3) return;
  cv::Mat first, second, t;
  cv::decomposeEssentialMat(essential, first, second, t);
  for (const cv::Mat& rotation : {first, second}) {
    motions.push_back(motion_of(rotation, t));
    motions.push_back(motion_of(rotation, -t));
  }
}

void take_apart(const cv::Mat& homography, const cv::Matx33d& k, std::vector<Rigid3>& motions) {
  std::vector<cv::Mat> rotations, translations, normals;
  cv::decomposeHomographyMat(homography, k, rotations, translations, normals);
  for (std::size_t i = 0; i < rotations.size(); ++i)
    if (cv::norm(translations[i]) > kLeastMotion)
      motions.push_back(motion_of(rotations[i], translations[i]));
}

void add_from_homography(const std::vector<cv::Point2d>& a, const std::vector<cv::Point2d>& b,
                         const cv::Matx33d& k, std::vector<Rigid3>& motions) {
  cv::Mat mask;
  const cv::Mat homography = cv::findHomography(a, b, mask, usac(2));
  if (homography.rows != 3 || homography.cols != 3) return;
  take_apart(homography, k, motions);
}

void erase_broken(std::vector<Rigid3>& motions) {
  std::erase_if(motions, [](const Rigid3& m) { return !m.is_finite(); });
}

}  // namespace

std::vector<Rigid3> motion_hypotheses(const PinholeCamera& camera,
                                      std::span<const PixelPair> pairs) {
  constexpr std::size_t kMinPairs = 8;
  std::vector<Rigid3> motions;
  if (pairs.size() < kMinPairs) return motions;
  std::vector<cv::Point2d> a, b;
  for (const PixelPair& pair : pairs) {
    a.emplace_back(pair.a.x(), pair.a.y());
    b.emplace_back(pair.b.x(), pair.b.y());
  }
  const cv::Matx33d k(camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1);
  // Degenerate pairs, such as all on one line, make OpenCV throw.
  for (const auto add : {add_from_essential, add_from_homography}) try {
      add(a, b, k, motions);
    } catch (const cv::Exception& e) {
      log::debug("motion hypotheses: {}", e.what());
    }
  erase_broken(motions);
  return motions;
}

std::vector<Rigid3> planar_motions(const Rigid3& b_from_a, const Eigen::Vector3d& plane) {
  const Eigen::Matrix3d h =
      b_from_a.rotation.toRotationMatrix() + b_from_a.translation * plane.transpose();
  cv::Mat homography(3, 3, CV_64F);
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column) homography.at<double>(row, column) = h(row, column);
  std::vector<Rigid3> motions;
  try {
    take_apart(homography, cv::Matx33d::eye(), motions);
  } catch (const cv::Exception& e) {
    log::debug("planar motions: {}", e.what());
  }
  erase_broken(motions);
  return motions;
}

}  // namespace cairn
