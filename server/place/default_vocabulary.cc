#include "server/place/default_vocabulary.h"

// The file's bytes, put into the read-only data of the program by the assembler.
asm(".pushsection .rodata\n"
    ".balign 16\n"
    ".global cairn_vocabulary_begin\n"
    "cairn_vocabulary_begin:\n"
    ".incbin \"" CAIRN_VOCABULARY_FILE
    "\"\n"
    ".global cairn_vocabulary_end\n"
    "cairn_vocabulary_end:\n"
    ".popsection\n");

extern "C" const char cairn_vocabulary_begin[];
extern "C" const char cairn_vocabulary_end[];

namespace cairn {

Result<Vocabulary> default_vocabulary() {
  return Vocabulary::read({cairn_vocabulary_begin, cairn_vocabulary_end},
                          "the built-in vocabulary");
}

}  // namespace cairn
