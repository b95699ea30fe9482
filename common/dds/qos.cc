#include "common/dds/qos.h"

#include <dds/dds.h>

namespace cairn::dds {

void QosDeleter::operator()(dds_qos* qos) const {
  dds_delete_qos(qos);
}

QosPtr make_qos(Quality quality) {
  QosPtr qos(dds_create_qos());
  dds_qset_reliability(qos.get(), DDS_RELIABILITY_RELIABLE, DDS_MSECS(100));
  // Who is gone is told by silence after this long; found out at once when it leaves in order.
  dds_qset_liveliness(qos.get(), DDS_LIVELINESS_AUTOMATIC, DDS_SECS(3));
  switch (quality) {
    case Quality::kStream:
      dds_qset_durability(qos.get(), DDS_DURABILITY_VOLATILE);
      dds_qset_history(qos.get(), DDS_HISTORY_KEEP_ALL, 0);
      break;
    case Quality::kState:
      dds_qset_durability(qos.get(), DDS_DURABILITY_TRANSIENT_LOCAL);
      dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, 1);
      break;
    case Quality::kHistory:
      dds_qset_durability(qos.get(), DDS_DURABILITY_TRANSIENT_LOCAL);
      dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, kHistoryDepth);
      // What late joiners get: without it, one sample an instance.
      dds_qset_durability_service(qos.get(), 0, DDS_HISTORY_KEEP_LAST, kHistoryDepth,
                                  DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED);
      break;
    case Quality::kLatest:
      dds_qset_durability(qos.get(), DDS_DURABILITY_VOLATILE);
      dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, 1);
      break;
  }
  return qos;
}

QosPtr make_partition_qos(const std::string& partition) {
  QosPtr qos(dds_create_qos());
  dds_qset_partition1(qos.get(), partition.c_str());
  return qos;
}

}  // namespace cairn::dds
