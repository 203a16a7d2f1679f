// Where tests find things. Defined in one small file, so that no other object depends on where the tree lies and compilers' caches serve every clone.
#pragma once
#include <string>

std::string source_dir();   // the source tree
std::string binary_dir();   // the build
std::string shared_data();  // meshes beside the checkout; tests that need them skip when they are absent
