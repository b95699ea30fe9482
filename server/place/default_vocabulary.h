// The vocabulary that comes with Cairn, config/vocabulary.bin, as part of the program: a server is
// one file.
#pragma once

#include "server/place/vocabulary.h"

namespace cairn {

// Errors: none but for a program that was built with a damaged file.
Result<Vocabulary> default_vocabulary();

}  // namespace cairn
