#include "tests/paths.h"

std::string source_dir() {
  return KNEAD_SOURCE_DIR;
}
std::string binary_dir() {
  return KNEAD_BINARY_DIR;
}
std::string shared_data() {
  return KNEAD_SHARED_DATA;
}
