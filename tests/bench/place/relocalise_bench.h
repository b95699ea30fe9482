// What it costs the server to tell a lost client where it is, in a large map.
#pragma once

#include "server/place/vocabulary.h"

namespace cairn::bench {

// 3000 keyframes of 100 clients, each in a room of its own, and views of the rooms from beside.
void tell_relocalisation(const Vocabulary& vocabulary);

}  // namespace cairn::bench
