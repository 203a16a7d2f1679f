#include "io/vdb/vdb_module.h"

#include "io/module.h"

namespace knead {
namespace {

#ifdef KNEAD_VDB_IS_LINKED
const VdbFunctions& vdb() {
  return *knead_vdb_functions();
}
#else
extern "C" __attribute__((weak)) const VdbFunctions* knead_vdb_functions();  // null but in tests, which are linked with all objects

const VdbFunctions* load() {
  using Door = const VdbFunctions* (*)();
  return reinterpret_cast<Door>(load_module("OpenVDB", KNEAD_VDB_MODULE, "knead_vdb_functions"))();
}

const VdbFunctions& vdb() {
  static const VdbFunctions* functions = knead_vdb_functions ? knead_vdb_functions() : load();  // a failed load is tried again
  return *functions;
}
#endif

}  // namespace

Sdf build_sdf(Executor& executor, const SdfPlan& plan, DistanceAt distance) {
  return vdb().build_sdf(executor, plan, distance);
}
uint64_t estimate_sdf_bytes(Executor& executor, const SdfPlan& plan, DistanceAt distance) {
  return vdb().estimate_sdf_bytes(executor, plan, distance);
}
ReadSdf read_sdf(const std::string& path, const std::string& name, Executor& executor, uint64_t memory_limit) {
  return vdb().read_sdf(path, name, executor, memory_limit);
}
void write_sdf(const std::string& path, const Sdf& sdf, const std::string& name) {
  vdb().write_sdf(path, sdf, name);
}

}  // namespace knead
