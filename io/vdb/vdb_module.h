// Internal. OpenVDB's library takes 40 ms to load, longer than many a run takes, so what needs it stands in a module, libknead_vdb, that is loaded
// when a function of io/vdb/vdb.h is first called. In a static build it is linked like the rest.
#pragma once
#include "io/vdb/vdb.h"

namespace knead {

namespace openvdb_side {  // what io/vdb/vdb.h declares, as it is done
Sdf build_sdf(Executor& executor, const SdfPlan& plan, DistanceAt distance);
uint64_t estimate_sdf_bytes(Executor& executor, const SdfPlan& plan, DistanceAt distance);
ReadSdf read_sdf(const std::string& path, const std::string& name, Executor& executor, uint64_t memory_limit);
void write_sdf(const std::string& path, const Sdf& sdf, const std::string& name);
}  // namespace openvdb_side

struct VdbFunctions {
  decltype(openvdb_side::build_sdf)* build_sdf;
  decltype(openvdb_side::estimate_sdf_bytes)* estimate_sdf_bytes;
  decltype(openvdb_side::read_sdf)* read_sdf;
  decltype(openvdb_side::write_sdf)* write_sdf;
};

extern "C" KNEAD_API const VdbFunctions* knead_vdb_functions();  // the module's only door

}  // namespace knead
