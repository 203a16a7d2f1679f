#include "io/vdb/vdb_module.h"

#include <dlfcn.h>

#include <filesystem>

#include "graph/error.h"

namespace knead {
namespace {

#ifdef KNEAD_VDB_IS_LINKED
const VdbFunctions& vdb() {
  return *knead_vdb_functions();
}
#else
extern "C" __attribute__((weak)) const VdbFunctions* knead_vdb_functions();  // null but in tests, which are linked with all objects

[[noreturn]] void fail() {
  const char* reason = ::dlerror();
  throw Error(ErrorCode::kFile, std::string("OpenVDB's part of Knead cannot be loaded: ") + (reason ? reason : "unknown reason"),
              std::string(KNEAD_VDB_MODULE) + " must stand beside the knead library");
}

const VdbFunctions* load() {
  Dl_info here{};
  if (!::dladdr(reinterpret_cast<const void*>(&load), &here)) fail();
  const std::filesystem::path folder = std::filesystem::path(here.dli_fname).parent_path();
  void* module = ::dlopen((folder / KNEAD_VDB_MODULE).c_str(), RTLD_NOW | RTLD_LOCAL);
  if (!module) fail();
  using Door = const VdbFunctions* (*)();
  const auto door = reinterpret_cast<Door>(::dlsym(module, "knead_vdb_functions"));
  if (!door) fail();
  return door();
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
