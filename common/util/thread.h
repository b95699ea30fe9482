// What the system is told about threads.
#pragma once

namespace cairn {

// What the thread is called in top, perf and gdb; at most 15 characters are kept.
void name_this_thread(const char* name);

// From now on the calling thread gives way to others of the program when processors are scarce:
// each step costs it some 20 % of its share, 19 leaves next to nothing. For work that can wait
// while somebody waits for other work. There is no way back, and nothing happens where the system
// does not allow it.
void yield_to_others(int steps);

}  // namespace cairn
