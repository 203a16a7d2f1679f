#include "io/module.h"

#include <dlfcn.h>

#include <filesystem>

#include "graph/error.h"

namespace knead {

void* load_module(const std::string& part, const std::string& file, const char* door) {
  Dl_info here{};
  if (::dladdr(reinterpret_cast<const void*>(&load_module), &here)) {
    const std::filesystem::path folder = std::filesystem::path(here.dli_fname).parent_path();
    if (void* module = ::dlopen((folder / file).c_str(), RTLD_NOW | RTLD_LOCAL))
      if (void* found = ::dlsym(module, door)) return found;
  }
  const char* reason = ::dlerror();
  throw Error(ErrorCode::kFile, part + "'s part of Knead cannot be loaded: " + (reason ? reason : "unknown reason"),
              file + " must stand beside the knead library, and " + part + " be installed");
}

}  // namespace knead
