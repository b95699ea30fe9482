// How the saved map is replaced in pieces and yet all at once. What changes is first written beside
// the map, into the table `staged`; then one small transaction makes it part of the map
// (map.staged = 1); then it is moved to where it belongs. A crash before that transaction leaves
// the former map, one after it the new map: what was not moved yet is moved at the next start.
// Private to server/storage.
#pragma once

#include <string>
#include <vector>

#include "server/storage/map_codec.h"
#include "server/storage/pieces.h"

namespace cairn::storage {

// The tables of the estimate that have a row for each part of the map; all with the same columns.
enum class Table { kNodes, kLandmarks, kReplacedLandmarks, kRemovedKeyframes };
inline constexpr Table kTables[] = {Table::kNodes, Table::kLandmarks, Table::kReplacedLandmarks,
                                    Table::kRemovedKeyframes};

struct StagedRow {
  Table table;
  std::uint64_t origin, number;
  Blob data;  // empty: the row goes
};

// Writes rows beside the map. What was there must have been finished.
Status stage(Pieces& pieces, const std::vector<StagedRow>& rows);
// Within a transaction that writes the map's header too: from now on they are part of the map.
Status accept_staged(sqlite::Database& database);
// Moves what is part of the map to its place, and forgets what is not.
Status finish_staged(Pieces& pieces);
// For a file that may not be changed: this connection sees the tables as if that had been done.
Status show_staged(sqlite::Database& database);

}  // namespace cairn::storage
