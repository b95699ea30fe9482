// Place recognition: how surely and how fast words are looked up, revisits found, and what it
// costs.
//
//   ./dev bench place [--vocabulary FILE] [--curve]
//
// --curve trains vocabularies of several sizes first and tells what each finds. Walks are rendered
// and described once; the whole takes a minute or two.
#include <ctime>

#include <memory>
#include <random>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "common/feature/hamming.h"
#include "common/feature/matching.h"
#include "server/place/vocabulary_training.h"
#include "server/tool/training_images.h"
#include "tests/bench/place/flann_words.h"
#include "tests/bench/place/relocalise_bench.h"
#include "tests/bench/place/revisits.h"

namespace cairn::bench {
namespace {

// Of this thread: what others do on the machine does not count.
double cpu_ms() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) * 1e3 + static_cast<double>(t.tv_nsec) * 1e-6;
}

template <typename Work>
double milliseconds(Work&& work) {
  const double start = cpu_ms();
  work();
  return cpu_ms() - start;
}

// Walks by what is asked of them.
struct Case {
  std::string name;
  Scenery scenery;
};
struct World {
  std::vector<std::unique_ptr<Walk>> walks;
  std::vector<Case> revisits, strangers;

  const Walk* keep(Walk walk) {
    walks.push_back(std::make_unique<Walk>(std::move(walk)));
    return walks.back().get();
  }
};

World make_world() {
  World world;
  const auto desk = world.keep(scene_walk("desk", 0, 850, 10));
  const auto other_desk = world.keep(scene_walk("desk", 1, 450, 10));
  const auto hall = world.keep(scene_walk("hall", 0, 800, 10));
  const auto other_hall = world.keep(scene_walk("hall", 1, 500, 10));
  const auto corridor = world.keep(scene_walk("corridor", 0, 1260, 10));
  const auto weak = world.keep(scene_walk("weak", 0, 650, 10));
  world.revisits = {{"desk, two clients", Scenery({desk, other_desk})},
                    {"hall, two clients", Scenery({hall, other_hall})},
                    {"corridor, 1.1 rounds", Scenery({corridor})},
                    {"weak, 1.3 rounds", Scenery({weak})}};
  if (auto kitchen = kitchen_walk(5))
    world.revisits.push_back({"7-Scenes kitchen", Scenery({world.keep(std::move(*kitchen))}, 1.0)});
  world.strangers = {
      {"posters, no revisit", Scenery({world.keep(scene_walk("posters", 0, 700, 10))})},
      {"bricks, no revisit", Scenery({world.keep(scene_walk("bricks", 0, 700, 10))})}};
  return world;
}

std::string percent(int part, int whole) {
  return whole > 0 ? fmt::format("{:.0f} %", 100.0 * part / whole) : "-";
}

void tell_revisits(const Vocabulary& vocabulary, const World& world) {
  fmt::print(
      "\nRevisits, {} words; right: {:.0f} % overlap; recall over views that see {:.0f} % "
      "of an earlier one\n\n",
      vocabulary.size(), 100 * kIsRight, 100 * kMustFind);
  fmt::print(
      "| walk | views | revisits | best match right | first candidate right | any right | "
      "candidates | precision |\n|---|---|---|---|---|---|---|---|\n");
  auto all = world.revisits;
  all.insert(all.end(), world.strangers.begin(), world.strangers.end());
  for (const Case& c : all) {
    const RevisitScore s = score_revisits(vocabulary, c.scenery, {});
    fmt::print("| {} | {} | {} | {} | {} | {} | {} | {} |\n", c.name, s.views, s.revisits,
               percent(s.places, s.revisits), percent(s.first_right, s.revisits),
               percent(s.any_right, s.revisits), s.candidates, percent(s.right, s.candidates));
  }
}

// Descriptors of all walks, thinned to about `count`.
std::vector<Descriptor> some_descriptors(const World& world, std::size_t count) {
  std::vector<Descriptor> all, some;
  for (const auto& walk : world.walks)
    for (const View& view : walk->views)
      all.insert(all.end(), view.descriptors.begin(), view.descriptors.end());
  for (std::size_t i = 0; i < count; ++i) some.push_back(all[i * all.size() / count]);
  return some;
}

// What of a view's mutual matches with the next one also has the same word, and the same branch at
// several levels of the tree.
void tell_repeats(const Vocabulary& vocabulary, const World& world) {
  fmt::print(
      "\nMatches between neighbouring views (1/6 to 1/3 s apart) that have the same word or "
      "branch\n\n| | | same word | same branch |\n|---|---|---|---|\n");
  const auto tell = [&](const Vocabulary& v, std::size_t beam) {
    int matches = 0, same_word = 0, same_branch = 0;
    for (const auto& walk : world.walks) {
      for (std::size_t i = 1; i < walk->views.size(); i += 10) {
        const auto &a = walk->views[i - 1].descriptors, &b = walk->views[i].descriptors;
        const Words in_a = v.words(a, beam), in_b = v.words(b, beam);
        for (const FeatureMatch& m : match_mutual(a, b, kStrictDistance, 0.8f)) {
          ++matches;
          same_word += in_a.word_of_feature[m.a] == in_b.word_of_feature[m.b];
          same_branch += in_a.branch_of_feature[m.a] == in_b.branch_of_feature[m.b];
        }
      }
    }
    fmt::print("| beam {} | {} branches | {} | {} |\n", beam, v.branches(),
               percent(same_word, matches), percent(same_branch, matches));
  };
  for (const std::size_t beam : {1u, 2u, 4u, 8u, 16u}) tell(vocabulary, beam);
  for (const std::uint32_t level : {1u, 2u, 3u}) {
    VocabularyTree tree = vocabulary.tree();
    tree.branch_level = level;
    if (const auto other = Vocabulary::make(std::move(tree))) tell(*other, Vocabulary::kBeam);
  }
}

// What the width of the descent and the demands on candidates change, over all walks with revisits.
void tell_options(const Vocabulary& vocabulary, const World& world) {
  fmt::print(
      "\nOptions\n\n| | best match right | any candidate right | candidates of all walks | "
      "precision |\n|---|---|---|---|---|\n");
  auto all = world.revisits;
  all.insert(all.end(), world.strangers.begin(), world.strangers.end());
  const auto tell = [&](const std::string& name, const CandidateOptions& options,
                        std::size_t beam) {
    RevisitScore sum;
    for (const Case& c : all) {
      const RevisitScore s = score_revisits(vocabulary, c.scenery, options, beam);
      sum.revisits += s.revisits, sum.places += s.places, sum.any_right += s.any_right;
      sum.right += s.right, sum.candidates += s.candidates;
    }
    fmt::print("| {} | {} | {} | {} | {} |\n", name, percent(sum.places, sum.revisits),
               percent(sum.any_right, sum.revisits), sum.candidates,
               percent(sum.right, sum.candidates));
  };
  for (const std::size_t beam : {1u, 2u, 4u, 8u, 16u}) tell(fmt::format("beam {}", beam), {}, beam);
  for (const double share : {0.4, 0.8, 1.0})
    tell(fmt::format("bar_share {}", share), {.bar_share = share}, Vocabulary::kBeam);
  for (const int n : {1, 2, 3})
    tell(fmt::format("consistency {}", n), {.consistency = n}, Vocabulary::kBeam);
  for (const int n : {1, 5}) tell(fmt::format("most {}", n), {.most = n}, Vocabulary::kBeam);
}

void tell_look_up(const Vocabulary& vocabulary, const World& world) {
  const auto wanted = some_descriptors(world, 20000);
  std::vector<Descriptor> words;
  for (std::uint32_t w = 0; w < vocabulary.size(); ++w) words.push_back(vocabulary.centre(w));
  std::vector<int> truth;
  const double all_ms = milliseconds([&] {
    for (const Descriptor& d : wanted) truth.push_back(nearest(d, words).distance);
  });
  const auto tell = [&](const std::string& how, double ms, const auto& word_of) {
    int right = 0;
    long excess = 0;
    for (std::size_t i = 0; i < wanted.size(); ++i) {
      const int distance = hamming_distance(wanted[i], words[word_of(i)]);
      right += distance == truth[i];
      excess += distance - truth[i];
    }
    const auto n = static_cast<double>(wanted.size());
    fmt::print("| {} | {:.1f} % | {:.2f} | {:.3f} |\n", how, 100 * right / n,
               static_cast<double>(excess) / n, 1000 * ms / n);
  };
  fmt::print(
      "\nLook-up of a word\n\n| | nearest of all | bits too far, mean | ms for 1000 features "
      "|\n|---|---|---|---|\n| all words compared | 100 % | 0 | {:.3f} |\n",
      1000 * all_ms / static_cast<double>(wanted.size()));
  std::vector<std::uint32_t> found(wanted.size());
  for (const std::size_t beam : {1u, 2u, 4u, 8u, 16u}) {
    const double ms = milliseconds([&] {
      for (std::size_t i = 0; i < wanted.size(); ++i)
        found[i] = vocabulary.word_of(wanted[i], beam);
    });
    tell(fmt::format("tree, beam {}", beam), ms, [&](std::size_t i) { return found[i]; });
  }
  for (const int checks : {32, 128, 512, 2048}) {
    std::unique_ptr<FlannWords> flann;
    const double build = milliseconds(
        [&] { flann = std::make_unique<FlannWords>(words, FlannOptions{.checks = checks}); });
    const double ms = milliseconds([&] { found = flann->nearest(wanted); });
    tell(fmt::format("FLANN, 4 trees, {} checks (built in {:.0f} ms)", checks, build), ms,
         [&](std::size_t i) { return found[i]; });
  }
}

// Keyframes in a row, each covisible with the 15 before and the 15 after it.
Map long_map(std::uint32_t keyframes) {
  Map map;
  for (std::uint32_t k = 0; k < keyframes; ++k) {
    KeyframeNode node;
    for (std::uint32_t step = 1; step <= 15; ++step) {
      const int shared = 200 - 13 * static_cast<int>(step);
      if (k >= step) node.covisible.edit().push_back({{1, k - step}, shared});
      if (k + step < keyframes) node.covisible.edit().push_back({{1, k + step}, shared});
    }
    if (k > 0) node.parent = {1, k - 1};
    map.keyframes.insert({1, k}, std::move(node));
  }
  return map;
}

// 5000 keyframes, each half of one view and half of another one.
void tell_costs(const Vocabulary& vocabulary, const World& world) {
  std::vector<const View*> views;
  for (const auto& walk : world.walks)
    for (const View& view : walk->views) views.push_back(&view);
  std::mt19937_64 random(1);
  PlaceIndex index;
  std::vector<BagOfWords> queries;
  double words_ms = 0, add_ms = 0, query_ms = 0, worst_ms = 0;
  constexpr std::uint32_t kKeyframes = 5000, kQueries = 200;
  for (std::uint32_t k = 0; k < kKeyframes; ++k) {
    std::vector<Descriptor> mixed;
    for (int half = 0; half < 2; ++half) {
      const auto& from = views[random() % views.size()]->descriptors;
      for (std::size_t i = static_cast<std::size_t>(half); i < from.size(); i += 2)
        mixed.push_back(from[i]);
    }
    Words words;
    words_ms += milliseconds([&] { words = vocabulary.words(mixed); });
    if (k % (kKeyframes / kQueries) == 0) queries.push_back(words.bag);
    add_ms += milliseconds([&] { index.add({1, k}, std::move(words)); });
  }
  const Map map = long_map(kKeyframes);
  LoopCandidates loops;
  double find_ms = 0;
  for (std::uint32_t k = 0; k < kKeyframes; k += kKeyframes / kQueries)
    find_ms += milliseconds([&] { (void)loops.find(map, index, {1, k}); });
  for (const BagOfWords& bag : queries) {
    const double ms = milliseconds([&] { (void)index.query(bag); });
    query_ms += ms;
    worst_ms = std::max(worst_ms, ms);
  }
  fmt::print(
      "\nAt {} keyframes: query {:.2f} ms mean, {:.2f} ms worst; a keyframe's words {:.2f} "
      "ms, adding it {:.3f} ms; its candidates, query included, {:.2f} ms\n",
      index.size(), query_ms / static_cast<double>(queries.size()), worst_ms, words_ms / kKeyframes,
      add_ms / kKeyframes, find_ms / kQueries);
}

// One line for each size: recall over all walks with revisits.
int tell_curve(const World& world) {
  const auto files = images_in({photos_folder()});
  if (!files) {
    fmt::print(stderr, "place: the curve needs the training images: {}\n", files.message());
    return 1;
  }
  auto images = describe_images(*files, 1000);
  const auto scenes = describe_scenes(
      {"desk", "hall", "corridor", "weak", "bare", "posters", "bricks"}, 30, 9001, 1000);
  if (!images || !scenes) return 1;
  images->insert(images->end(), scenes->begin(), scenes->end());
  fmt::print(
      "\nRecall against words\n\n| words | MB | best match right | any candidate right | "
      "precision |\n|---|---|---|---|---|\n");
  for (const std::size_t words : {1000u, 3000u, 10000u, 20000u, 33000u, 50000u, 100000u}) {
    const auto vocabulary =
        train_vocabulary(*images, {.words = words, .split_above = words > 40000 ? 4u : 8u});
    if (!vocabulary) return 1;
    RevisitScore sum;
    for (const Case& c : world.revisits) {
      const RevisitScore s = score_revisits(*vocabulary, c.scenery, {});
      sum.revisits += s.revisits, sum.places += s.places, sum.any_right += s.any_right;
      sum.right += s.right, sum.candidates += s.candidates;
    }
    const double bytes = 33.0 * static_cast<double>(vocabulary->tree().centres.size()) +
                         4.0 * static_cast<double>(vocabulary->size());
    fmt::print("| {} | {:.2f} | {} | {} | {} |\n", vocabulary->size(), bytes * 1e-6,
               percent(sum.places, sum.revisits), percent(sum.any_right, sum.revisits),
               percent(sum.right, sum.candidates));
  }
  return 0;
}

int run(const std::string& path, bool curve, bool relocalisation) {
  Result<Vocabulary> vocabulary{ErrorCode::kInternal, ""};
  const double load_ms = milliseconds([&] { vocabulary = Vocabulary::load(path); });
  if (!vocabulary) {
    fmt::print(stderr, "place: {}\n", vocabulary.message());
    return 1;
  }
  fmt::print("{}: {} words, loaded in {:.1f} ms\n", path, vocabulary->size(), load_ms);
  if (relocalisation) {
    tell_relocalisation(*vocabulary);
    return 0;
  }
  const World world = make_world();
  tell_revisits(*vocabulary, world);
  tell_options(*vocabulary, world);
  tell_repeats(*vocabulary, world);
  tell_look_up(*vocabulary, world);
  tell_costs(*vocabulary, world);
  tell_relocalisation(*vocabulary);
  return curve ? tell_curve(world) : 0;
}

}  // namespace
}  // namespace cairn::bench

int main(int argc, char** argv) {
  CLI::App app("Place recognition: recall, precision, time", "cairn_place_bench");
  std::string path = CAIRN_SOURCE_DIR "/config/vocabulary.bin";
  bool curve = false, relocalisation = false;
  app.add_option("--vocabulary", path, "File of the vocabulary")->capture_default_str();
  app.add_flag("--curve", curve, "Also train vocabularies of several sizes and compare them");
  app.add_flag("--relocalisation", relocalisation, "Only tell what finding a lost client costs");
  CLI11_PARSE(app, argc, argv);
  std::setvbuf(stdout, nullptr, _IOLBF, 0);  // tables grow under the eyes of whoever waits
  return cairn::bench::run(path, curve, relocalisation);
}
