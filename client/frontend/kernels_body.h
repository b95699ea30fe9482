// What the kernels are, included by one source file for each instruction set and by nothing else.
//
// Plain loops that GCC turns into vector code. Everything stands in an unnamed namespace and uses
// no function of another header: an inline function compiled here with AVX2 could otherwise become
// the whole program's copy of it.
#pragma once

#include <cstddef>
#include <cstdint>

#include "client/frontend/kernels.h"

#ifdef __SSSE3__
#include <immintrin.h>
#endif

namespace cairn {
namespace {

using u8 = std::uint8_t;
using i16 = std::int16_t;
using u16 = std::uint16_t;
using u32 = std::uint32_t;
using u64 = std::uint64_t;

constexpr int kBlock = 32;  // pixels taken at a time

inline u8 lesser(u8 a, u8 b) {
  return a < b ? a : b;
}
inline u8 greater(u8 a, u8 b) {
  return a > b ? a : b;
}
inline u64 load_64(const void* from) {
  u64 word;
  __builtin_memcpy(&word, from, sizeof word);
  return word;
}

// --- FAST

// False for most blocks: an arc of nine holds two neighbours of any four that lie a quarter circle
// apart, so both pairs of opposites must have one that stands out, on the same side.
template <int kPixels>
inline bool any_may_be_corner(const u8* p, const std::ptrdiff_t* o, u8 threshold) {
  alignas(32) u8 above[kPixels];
  for (int i = 0; i < kPixels; ++i) {
    const u8 a = p[o[0] + i], b = p[o[4] + i], c = p[o[8] + i], d = p[o[12] + i];
    const u8 e = p[o[2] + i], f = p[o[6] + i], g = p[o[10] + i], h = p[o[14] + i];
    const u8 bright =
        lesser(lesser(greater(a, c), greater(b, d)), lesser(greater(e, g), greater(f, h)));
    const u8 dark =
        greater(greater(lesser(a, c), lesser(b, d)), greater(lesser(e, g), lesser(f, h)));
    const u8 centre = p[i];
    const u8 contrast = greater(static_cast<u8>(greater(bright, centre) - centre),
                                static_cast<u8>(centre - lesser(dark, centre)));
    above[i] = static_cast<u8>(greater(contrast, threshold) - threshold);
  }
  u64 any = 0;
  for (int i = 0; i < kPixels; i += 8) any |= load_64(above + i);
  return any != 0;
}

// The score is the greatest, over all arcs of nine, of the least contrast on the arc, brighter or
// darker. The least of the arc is found first and the centre subtracted last, which gives the same.
// Two arcs that start one pixel apart share eight pixels. c: the circle.
#define CAIRN_PAIR(op, k) op(c[(k) % 16], c[((k) + 1) % 16])
#define CAIRN_FOUR(op, k) op(CAIRN_PAIR(op, k), CAIRN_PAIR(op, (k) + 2))
#define CAIRN_ARCS(op, other, k) \
  op(op(CAIRN_FOUR(op, (k) + 1), CAIRN_FOUR(op, (k) + 5)), other(c[k], c[((k) + 9) % 16]))
#define CAIRN_BEST_ARC(op, other)                                         \
  other(other(other(CAIRN_ARCS(op, other, 0), CAIRN_ARCS(op, other, 2)),  \
              other(CAIRN_ARCS(op, other, 4), CAIRN_ARCS(op, other, 6))), \
        other(other(CAIRN_ARCS(op, other, 8), CAIRN_ARCS(op, other, 10)), \
              other(CAIRN_ARCS(op, other, 12), CAIRN_ARCS(op, other, 14))))

inline u8 arc_score(const u8 (&c)[16], u8 centre) {
  const u8 bright = CAIRN_BEST_ARC(lesser, greater), dark = CAIRN_BEST_ARC(greater, lesser);
  return greater(static_cast<u8>(greater(bright, centre) - centre),
                 static_cast<u8>(centre - lesser(dark, centre)));
}

#undef CAIRN_BEST_ARC
#undef CAIRN_ARCS
#undef CAIRN_FOUR
#undef CAIRN_PAIR

template <int kPixels>
inline void score_block(const u8* p, const std::ptrdiff_t* o, u8 threshold, u8* __restrict out) {
  for (int i = 0; i < kPixels; ++i) {
    const u8 c[16] = {p[o[0] + i],  p[o[1] + i],  p[o[2] + i],  p[o[3] + i],
                      p[o[4] + i],  p[o[5] + i],  p[o[6] + i],  p[o[7] + i],
                      p[o[8] + i],  p[o[9] + i],  p[o[10] + i], p[o[11] + i],
                      p[o[12] + i], p[o[13] + i], p[o[14] + i], p[o[15] + i]};
    const u8 score = arc_score(c, p[i]);
    out[i] = score > threshold ? score : u8{0};
  }
}

// The last block overlaps the one before: nothing beyond the row is touched.
template <int kPixels>
inline void score_row(const u8* row, int width, const std::ptrdiff_t* circle, u8 threshold,
                      u8* out) {
  for (int next = 0; next < width; next += kPixels) {
    const int x = next + kPixels <= width ? next : width - kPixels;
    if (any_may_be_corner<kPixels>(row + x, circle, threshold))
      score_block<kPixels>(row + x, circle, threshold, out + x);
  }
}

void fast_scores(const u8* row, int width, const std::ptrdiff_t* circle, u8 threshold, u8* out) {
  if (width >= kBlock)
    score_row<kBlock>(row, width, circle, threshold, out);
  else if (width >= 16)
    score_row<16>(row, width, circle, threshold, out);
  else
    for (int x = 0; x < width; ++x) score_block<1>(row + x, circle, threshold, out + x);
}

int fast_peaks(const u8* above, const u8* row, const u8* below, int width, u16* peaks) {
  int found = 0;
  for (int x = 0; x < width; x += kBlock) {
    const u8 *a = above + x, *r = row + x, *b = below + x;
    alignas(32) u8 is_peak[kBlock];
    for (int i = 0; i < kBlock; ++i) {
      const u8 before = greater(greater(a[i - 1], a[i]), greater(a[i + 1], r[i - 1]));
      const u8 after = greater(greater(b[i - 1], b[i]), greater(b[i + 1], r[i + 1]));
      // s > after and s >= before and s > 0, with differences that stop at 0
      const u8 least = greater(after, static_cast<u8>(greater(before, 1) - 1));
      is_peak[i] = static_cast<u8>(greater(r[i], least) - least);
    }
    for (int i = 0; i < kBlock; i += 8) {
      u64 word = load_64(is_peak + i);
      while (word != 0) {
        const int byte = __builtin_ctzll(word) / 8;
        word &= ~(u64{255} << (8 * byte));
        if (x + i + byte < width) peaks[found++] = static_cast<u16>(x + i + byte);
      }
    }
  }
  return found;
}

void fast_scores_16(const u8 around[16][16], const u8 centre[16], u8 out[16]) {
  for (int i = 0; i < 16; ++i) {
    const u8 c[16] = {around[0][i],  around[1][i],  around[2][i],  around[3][i],
                      around[4][i],  around[5][i],  around[6][i],  around[7][i],
                      around[8][i],  around[9][i],  around[10][i], around[11][i],
                      around[12][i], around[13][i], around[14][i], around[15][i]};
    out[i] = arc_score(c, centre[i]);
  }
}

// --- sharpening

void sharpen_row(const u8* __restrict above, const u8* __restrict row, const u8* __restrict below,
                 int begin, int end, u8* __restrict out) {
  for (int x = begin; x < end; ++x) {
    const auto value = static_cast<i16>(5 * row[x] - row[x - 1] - row[x + 1] - above[x] - below[x]);
    const auto positive = static_cast<i16>(value < 0 ? 0 : value);
    out[x] = static_cast<u8>(positive > 255 ? 255 : positive);
  }
}

// --- blur

// exp(-x^2 / 8) for x = 0 .. 3, in 256ths so that both sides together give 256.
constexpr u16 kBlur[4] = {54, 49, 34, 18};

void blur_down(const u8* const rows[7], int width, u16* __restrict out) {
  const u8 *a = rows[0], *b = rows[1], *c = rows[2], *d = rows[3], *e = rows[4], *f = rows[5],
           *g = rows[6];
  for (int x = 0; x < width; ++x) {
    const auto sum = static_cast<u16>(kBlur[0] * d[x] + kBlur[1] * (c[x] + e[x]) +
                                      kBlur[2] * (b[x] + f[x]) + kBlur[3] * (a[x] + g[x]));
    out[x] = static_cast<u16>(sum >> 1);
  }
}

// The upper half of a product: one instruction.
inline u16 high_product(u16 a, u16 b) {
  return static_cast<u16>((u32{a} * b) >> 16);
}

void blur_across(const u16* __restrict in, int width, u8* __restrict out) {
  for (int x = 0; x < width; ++x) {
    const auto one = static_cast<u16>(in[x - 1] + in[x + 1]);
    const auto two = static_cast<u16>(in[x - 2] + in[x + 2]);
    const auto three = static_cast<u16>(in[x - 3] + in[x + 3]);
    const auto sum = static_cast<u16>(
        high_product(in[x], kBlur[0] << 8) + high_product(one, kBlur[1] << 8) +
        high_product(two, kBlur[2] << 8) + high_product(three, kBlur[3] << 8) + 64);
    out[x] = static_cast<u8>(sum >> 7);
  }
}

// --- resize

void resize_across(const u8* row, const ResizeColumns& m, i16* out) {
#ifdef __SSSE3__
  if (m.in_groups) {
    const __m128i sign = _mm_set1_epi8(-128);
    for (int x = 0; x < m.width; x += 8) {
      const auto load = [](const void* from) {
        return _mm_loadu_si128(static_cast<const __m128i*>(from));
      };
      const __m128i source = _mm_xor_si128(load(row + m.group[x / 8]), sign);
      const __m128i pairs = _mm_shuffle_epi8(source, load(m.shuffle + 2 * x));
      _mm_storeu_si128(reinterpret_cast<__m128i*>(out + x),
                       _mm_maddubs_epi16(load(m.weight + 2 * x), pairs));
    }
    return;
  }
#endif
  for (int x = 0; x < m.width; ++x) {
    const u8* left = row + m.from[x];
    out[x] = static_cast<i16>(m.weight[2 * x] * (left[0] - 128) +
                              m.weight[2 * x + 1] * (left[m.step[x]] - 128));
  }
}

void resize_down(const i16* __restrict upper, const i16* __restrict lower, int weight, int width,
                 u8* __restrict out) {
  const auto w = static_cast<i16>(weight);
  for (int x = 0; x < width; ++x) {
    const auto difference = static_cast<i16>(lower[x] - upper[x]);
    const auto half = static_cast<i16>((difference * w) >> 16);  // one instruction
    const auto value = static_cast<i16>(upper[x] + half + half);
    out[x] = static_cast<u8>(static_cast<u16>(value + 0x4000 + 64) >> 7);
  }
}

// --- orientation

constexpr int kRadius = 15;
constexpr int kWidth = 32;  // columns -16 .. 15: whole vectors; the first one is always masked out
constexpr int kLeft = 16;

// For each distance of a row from the centre, which columns lie in the circle: all ones or none.
struct Masks {
  i16 row[kRadius + 1][kWidth];
};
constexpr Masks circle_masks() {
  Masks masks{};
  for (int v = 0; v <= kRadius; ++v)
    for (int i = 0; i < kWidth; ++i) {
      const int u = i - kLeft;
      // Radius 15.5: pixels whose centre is nearer than the middle between 15 and 16.
      const bool inside = 4 * (u * u + v * v) <= 31 * 31 && u >= -kRadius;
      masks.row[v][i] = inside ? -1 : 0;
    }
  return masks;
}
constexpr Masks kMasks = circle_masks();

// Rows v and -v are taken together, and sums kept per column in 16 bits, which suffice:
// 31 rows * 255 and 2 * (1 + ... + 15) / 2 * 255 are below 2^15.
Moments disc_moments(const u8* middle, std::ptrdiff_t stride) {
  alignas(64) i16 sums[kWidth];          // sum over rows of I
  alignas(64) i16 moments[kWidth] = {};  // sum over rows of v * I
  const u8* centre = middle - kLeft;
  for (int i = 0; i < kWidth; ++i) sums[i] = static_cast<i16>(centre[i] & kMasks.row[0][i]);
  for (int v = 1; v <= kRadius; ++v) {
    const u8 *above = centre - v * stride, *below = centre + v * stride;
    const i16* mask = kMasks.row[v];
    for (int i = 0; i < kWidth; ++i) {
      const auto difference = static_cast<i16>((below[i] - above[i]) & mask[i]);
      sums[i] = static_cast<i16>(sums[i] + ((above[i] + below[i]) & mask[i]));
      moments[i] = static_cast<i16>(moments[i] + static_cast<i16>(v) * difference);
    }
  }
  Moments m;
  for (int i = 0; i < kWidth; ++i) {
    m.x += (i - kLeft) * sums[i];
    m.y += moments[i];
  }
  return m;
}

// --- entropy

// Eight histograms in turn: equal neighbours would otherwise wait for each other's store.
void histogram(const u8* block, std::ptrdiff_t stride, int width, int height, u16 counts[256]) {
  alignas(64) u16 bins[8][256] = {};
  for (int y = 0; y < height; ++y, block += stride) {
    int x = 0;
    for (; x + 8 <= width; x += 8) {
      const u64 word = load_64(block + x);
      ++bins[0][word & 255];
      ++bins[1][(word >> 8) & 255];
      ++bins[2][(word >> 16) & 255];
      ++bins[3][(word >> 24) & 255];
      ++bins[4][(word >> 32) & 255];
      ++bins[5][(word >> 40) & 255];
      ++bins[6][(word >> 48) & 255];
      ++bins[7][word >> 56];
    }
    for (; x < width; ++x) ++bins[0][block[x]];
  }
  for (int i = 0; i < 256; ++i)
    counts[i] = static_cast<u16>(bins[0][i] + bins[1][i] + bins[2][i] + bins[3][i] + bins[4][i] +
                                 bins[5][i] + bins[6][i] + bins[7][i]);
}

// --- descriptor

void describe(const u8* centre, const std::int32_t* first, const std::int32_t* second, u64 out[4]) {
  for (int word = 0; word < 4; ++word) {
    u64 bits = 0;
    for (int i = 64 * word + 63; i >= 64 * word; --i)
      bits = bits + bits + (centre[first[i]] < centre[second[i]]);
    out[word] = bits;
  }
}

constexpr Kernels make_kernels(const char* name) {
  return {name,        fast_scores,   fast_peaks,  fast_scores_16, sharpen_row, blur_down,
          blur_across, resize_across, resize_down, disc_moments,   histogram,   describe};
}

}  // namespace
}  // namespace cairn
