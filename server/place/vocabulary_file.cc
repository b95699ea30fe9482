#include "server/place/vocabulary_file.h"

#include <bit>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>

namespace cairn {
namespace {

static_assert(std::endian::native == std::endian::little, "the file is written as memory holds it");

constexpr char kMagic[8] = {'C', 'A', 'I', 'R', 'N', 'V', 'O', 'C'};
struct Header {
  char magic[8] = {};
  std::uint32_t version = 0, nodes = 0, words = 0, branch_level = 0;
  std::uint64_t checksum = 0;
};
static_assert(sizeof(Header) == 32);
constexpr std::uintmax_t kMaxFile = 256 << 20;

std::uintmax_t size_of(const Header& header) {
  return sizeof header + std::uintmax_t{header.nodes} * (sizeof(Descriptor) + 1) +
         std::uintmax_t{header.words} * sizeof(float);
}

// FNV-1a, 64 bits at a time instead of 8 for speed; what is left over is padded with zeros.
std::uint64_t fnv1a(std::uint64_t hash, const void* data, std::size_t bytes) {
  const char* at = static_cast<const char*>(data);
  for (std::size_t i = 0; i < bytes; i += 8) {
    std::uint64_t part = 0;
    std::memcpy(&part, at + i, std::min<std::size_t>(8, bytes - i));
    hash = (hash ^ part) * 0x100000001b3ULL;
    hash ^= hash >> 29;  // so that high bits reach the low ones
  }
  return hash;
}

template <typename T>
std::size_t bytes_of(const std::vector<T>& values) {
  return values.size() * sizeof(T);
}

// The arrays of the file in their order.
template <typename Tree, typename F>
void for_each_array(Tree& tree, F&& f) {
  f(tree.centres);
  f(tree.child_counts);
  f(tree.weights);
}

Error damaged(const std::string& path, const std::string& what) {
  return {ErrorCode::kCorrupt,
          path + ": not a usable vocabulary: " + what + "; make it anew with 'cairn vocab train'"};
}

Status check(const Header& header, const std::string& path) {
  if (std::memcmp(header.magic, kMagic, sizeof kMagic) != 0)
    return damaged(path, "it does not begin as one");
  if (header.version != Vocabulary::kVersion)
    return {ErrorCode::kVersion, path + ": vocabulary of version " +
                                     std::to_string(header.version) + ", this program reads " +
                                     std::to_string(Vocabulary::kVersion)};
  return {};
}

}  // namespace

std::uint64_t checksum_of(const VocabularyTree& tree) {
  std::uint64_t hash = 0xcbf29ce484222325ULL ^ tree.branch_level;
  for_each_array(tree,
                 [&](const auto& array) { hash = fnv1a(hash, array.data(), bytes_of(array)); });
  return hash;
}

Status Vocabulary::save(const std::string& path) const {
  Header header;
  std::memcpy(header.magic, kMagic, sizeof kMagic);
  header.version = kVersion;
  header.nodes = static_cast<std::uint32_t>(tree_.centres.size());
  header.words = static_cast<std::uint32_t>(size());
  header.branch_level = tree_.branch_level;
  header.checksum = checksum_;
  const std::string unfinished = path + ".part";
  std::ofstream out(unfinished, std::ios::binary | std::ios::trunc);
  const auto put = [&](const void* data, std::size_t bytes) {
    out.write(static_cast<const char*>(data), static_cast<std::streamsize>(bytes));
  };
  put(&header, sizeof header);
  for_each_array(tree_, [&](const auto& array) { put(array.data(), bytes_of(array)); });
  out.close();
  std::error_code error;
  if (out) std::filesystem::rename(unfinished, path, error);
  if (out && !error) return {};
  const std::string why = error ? error.message() : std::strerror(errno);
  std::filesystem::remove(unfinished, error);
  return {ErrorCode::kUnavailable, "cannot write " + path + ": " + why};
}

Result<Vocabulary> Vocabulary::load(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::error_code error;
  const std::uintmax_t bytes = std::filesystem::file_size(path, error);
  if (!in || error)
    return {ErrorCode::kNotFound, "cannot read " + path + ": " + std::strerror(errno)};
  // Before memory is asked for.
  if (bytes > kMaxFile) return damaged(path, "it is far too large");
  std::vector<char> file(bytes);
  if (!in.read(file.data(), static_cast<std::streamsize>(bytes)))
    return damaged(path, "it can't be read to its end");
  return read(file, path);
}

Result<Vocabulary> Vocabulary::read(std::span<const char> file, const std::string& name) {
  Header header;
  if (file.size() < sizeof header) return damaged(name, "it is too short");
  std::memcpy(&header, file.data(), sizeof header);
  if (const Status status = check(header, name); !status) return status.error();
  if (file.size() != size_of(header)) return damaged(name, "it has not the size that it says");
  VocabularyTree tree;
  tree.branch_level = header.branch_level;
  tree.centres.resize(header.nodes);
  tree.child_counts.resize(header.nodes);
  tree.weights.resize(header.words);
  const char* at = file.data() + sizeof header;
  for_each_array(tree, [&](auto& array) {
    std::memcpy(array.data(), at, bytes_of(array));
    at += bytes_of(array);
  });
  if (checksum_of(tree) != header.checksum) return damaged(name, "its checksum is wrong");
  auto vocabulary = make(std::move(tree));
  if (!vocabulary) return damaged(name, vocabulary.message());
  return vocabulary;
}

}  // namespace cairn
