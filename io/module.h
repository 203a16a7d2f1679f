// A part of the library that needs a large other library, in a module of its own beside libknead, which is loaded when the part is first needed.
#pragma once
#include <string>

namespace knead {

// The module's one function `door`, from `file` in the folder of the library. Throws Error(kFile) that says "PART's part of Knead cannot be loaded", why, and
// what would help.
void* load_module(const std::string& part, const std::string& file, const char* door);

}  // namespace knead
