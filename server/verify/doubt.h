// Step 5 of verification: what speaks against a transform that fits. Private to server/verify.
#pragma once

#include <string>

#include "server/verify/grow.h"

namespace cairn {

// Empty when nothing does; else what, in one line. Fills in the figures of `v`.
std::string doubt(const Side& query, const Side& candidate, const Matches& matches,
                  const Sim3& candidate_from_query, const Grown& grown,
                  const VerifyOptions& options, Verification& v);

}  // namespace cairn
