// The inner loops of the front end, compiled twice: for the base line that every machine has, and
// for AVX2, where there is one. Which set runs is decided once, at run time.
//
// All of them work on whole numbers, so that every set gives the same result to the last bit: the
// features do not depend on the machine.
#pragma once

#include <cstddef>
#include <cstdint>

namespace cairn {

// What the horizontal half of a resize does to one row; see ResizeMap in resize.h.
struct ResizeColumns {
  int width;                    // of the result; `from`, `weight` and `shuffle` go on to a
                                // multiple of eight
  bool in_groups;               // whether `group` and `shuffle` may be used
  const std::int32_t* from;     // left one of the two source pixels
  const std::int32_t* step;     // to the right one, 0 or 1
  const std::uint8_t* weight;   // two for each pixel: of the left and the right one, sum 128
  const std::int32_t* group;    // for each eight pixels: where their 16 source bytes start
  const std::uint8_t* shuffle;  // two for each pixel: which of those bytes are its sources
};

struct Moments {
  int x = 0, y = 0;  // sums of u I and v I over a disc
};

constexpr inline std::size_t kFastSpare = 33;

struct Kernels {
  const char* name;

  // FAST scores (contrast of the best arc) of `width` pixels of a row from `row` on, where they
  // exceed `threshold`; elsewhere `out` stays as it is, or becomes 0. `circle`: 16 offsets to the
  // pixels around.
  void (*fast_scores)(const std::uint8_t* row, int width, const std::ptrdiff_t* circle,
                      std::uint8_t threshold, std::uint8_t* out);
  // Where in a row of scores none of the eight neighbours exceeds the one that is not 0; of equal
  // neighbours the last counts. Writes the places to `peaks`, returns how many. One byte before and
  // kFastSpare after each of the three rows are read.
  int (*fast_peaks)(const std::uint8_t* above, const std::uint8_t* row, const std::uint8_t* below,
                    int width, std::uint16_t* peaks);
  // The scores of 16 pixels that are given with their circles: around[k][i] is pixel k of the
  // circle of pixel i.
  void (*fast_scores_16)(const std::uint8_t around[16][16], const std::uint8_t centre[16],
                         std::uint8_t out[16]);
  // Eq. 8 of Luo et al. 2020 for the pixels begin .. end - 1, all with neighbours to both sides.
  void (*sharpen_row)(const std::uint8_t* above, const std::uint8_t* row, const std::uint8_t* below,
                      int begin, int end, std::uint8_t* out);
  // The two halves of the Gaussian blur (7x7, sigma 2). Between them values are in 1/128 grey
  // levels; the second half reads three of them to either side.
  void (*blur_down)(const std::uint8_t* const rows[7], int width, std::uint16_t* out);
  void (*blur_across)(const std::uint16_t* in, int width, std::uint8_t* out);
  // The two halves of a bilinear resize. Between them values are 128 (grey - 128), for `width`
  // rounded up to a multiple of eight. `weight` of the lower row in 1/32768.
  void (*resize_across)(const std::uint8_t* row, const ResizeColumns& columns, std::int16_t* out);
  void (*resize_down)(const std::int16_t* upper, const std::int16_t* lower, int weight, int width,
                      std::uint8_t* out);
  // First moments of the pixels within 15 pixels of `centre`; 16 pixels around may be read.
  Moments (*disc_moments)(const std::uint8_t* centre, std::ptrdiff_t stride);
  // Counts of grey levels in a block of at most 65535 pixels.
  void (*histogram)(const std::uint8_t* block, std::ptrdiff_t stride, int width, int height,
                    std::uint16_t counts[256]);
  // 256 tests: bit i is set where the pixel at first[i] is darker than that at second[i].
  void (*describe)(const std::uint8_t* centre, const std::int32_t* first,
                   const std::int32_t* second, std::uint64_t out[4]);
};

const Kernels& baseline_kernels();
// Null where this processor has no AVX2, or the program was built without.
const Kernels* avx2_kernels();
// The fastest that this processor can run.
const Kernels& best_kernels();

}  // namespace cairn
