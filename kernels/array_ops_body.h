// Plain operations on arrays, an index at a time, for any executor.
#pragma once
#include "kernels/row4.h"

namespace knead {

struct FillWords {
  static constexpr const char* kKernel = "fill_words";
  uint32_t* to;
  uint32_t word;
  uint32_t unused = 0;  // Padding would be copied to devices uninitialised.
  KNEAD_HD void operator()(uint32_t i) const { to[i] = word; }
};

// Every element becomes a value that only the device knows.
struct FillFrom {
  static constexpr const char* kKernel = "fill_from";
  const float* value;  // null: zero
  float* to;
  KNEAD_HD void operator()(uint32_t i) const { to[i] = value ? *value : 0.0f; }
};

struct CopyPoints {
  static constexpr const char* kKernel = "copy_points";
  const Vec3f* from;
  Vec3f* to;
  KNEAD_HD void operator()(uint32_t i) const { to[i] = from[i]; }
};

struct CopyRows {
  static constexpr const char* kKernel = "copy_rows";
  const Row4* from;
  Row4* to;
  KNEAD_HD void operator()(uint32_t i) const { to[i] = from[i]; }
};

// to = a + b, or a where b is null.
struct AddFloats {
  static constexpr const char* kKernel = "add_floats";
  const float *a, *b;
  float* to;
  KNEAD_HD void operator()(uint32_t i) const { to[i] = b ? a[i] + b[i] : a[i]; }
};

struct ScaleFloats {
  static constexpr const char* kKernel = "scale_floats";
  float* values;
  float by;
  uint32_t unused = 0;
  KNEAD_HD void operator()(uint32_t i) const { values[i] *= by; }
};

// to = a + by b
struct CombineRows {
  static constexpr const char* kKernel = "combine_rows";
  Row4* to;
  const Row4 *a, *b;
  float by;
  uint32_t unused = 0;
  KNEAD_HD void operator()(uint32_t i) const { put_row(to, i, row_at(a, i) + row_at(b, i) * by); }
};

}  // namespace knead
