#include "tests/bench/place/relocalise_bench.h"

#include <algorithm>
#include <ctime>

#include <fmt/format.h>

#include "server/relocaliser.h"
#include "tests/unit/server/verify/place_world.h"

namespace cairn::bench {
namespace {

constexpr std::uint64_t kRooms = 100;
constexpr int kKeyframesEach = 30;
const Rigid3 kBeside{so3_exp({0.02, 0.15, 0.03}), {1.3, 0.05, 0.2}};

Room furnished(std::uint64_t number) {
  Room room;
  add_clutter(room, number + 1, 2600, {-4, -2, 2}, {7, 2, 6});
  return room;
}

Keyframe view_of(const Room& room, std::uint64_t epoch) {
  Map own;
  const Visit visit(own, room, {.epoch = epoch, .keyframes = 1, .room_from_first = kBeside});
  Keyframe view = *own.keyframes.at(visit.id(0)).keyframe;
  view.matches.clear();
  return view;
}

// Of this thread: what else runs on the machine does not count.
double cpu_ms() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}

struct Times {
  std::vector<double> ms;
  int found = 0;

  void ask(const Map& map, const PlaceIndex& index, const Vocabulary& vocabulary,
           const Keyframe& view) {
    const double start = cpu_ms();
    const RelocaliseAnswer answer = relocalise(map, index, vocabulary, view, {});
    ms.push_back(cpu_ms() - start);
    found += answer.found;
  }
  void tell(const char* what) {
    std::sort(ms.begin(), ms.end());
    fmt::print("{}: {} of {} found, {:.1f} ms median, {:.1f} ms worst\n", what, found, ms.size(),
               ms[ms.size() / 2], ms.back());
  }
};

}  // namespace

void tell_relocalisation(const Vocabulary& vocabulary) {
  Map map;
  map.id = {1};
  PlaceIndex index;
  std::size_t features = 0;
  for (std::uint64_t number = 0; number < kRooms; ++number) {
    const Room room = furnished(number);
    const Visit visit(map, room, {.epoch = 100 + number, .keyframes = kKeyframesEach, .step = 0.1});
    for (int k = 0; k < kKeyframesEach; ++k) {
      const Features& of_k = map.keyframes.at(visit.id(k)).features();
      features += of_k.size();
      index.add(visit.id(k), vocabulary.words(of_k.descriptors));
    }
  }
  fmt::print("\nRelocalisation among {} keyframes of {} features, {} landmarks\n", index.size(),
             features / index.size(), map.landmarks.size());
  Times known, unknown;
  for (std::uint64_t number = 0; number < kRooms; number += 2) {
    known.ask(map, index, vocabulary, view_of(furnished(number), 1000 + number));
    unknown.ask(map, index, vocabulary, view_of(furnished(kRooms + number), 1000 + number));
  }
  known.tell("views of places in the map");
  unknown.tell("views of places that are not");
}

}  // namespace cairn::bench
