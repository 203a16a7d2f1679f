// Values that frames share through Context::once and that no port carries: prepared tables, search structures, results of one node's own making.
//
// A struct becomes such a value by saying its name, and by showing its buffers where it has any that the cache should count:
//   struct PreparedRest {
//     static constexpr const char* kOpaqueName = "PreparedRest";
//     std::shared_ptr<const EquilibriumRest> rest;
//     void each_buffer(auto&& f) { f(...); }   // optional
//   };
#pragma once
#include "graph/value.h"

namespace knead {

template <class T>
requires requires {
  T::kOpaqueName;
}
struct PortTraits<T> {
  static constexpr const char* name = T::kOpaqueName;
  template <class F>
  static void each_buffer([[maybe_unused]] T& value, [[maybe_unused]] F&& f) {
    if constexpr (requires { value.each_buffer(f); }) value.each_buffer(f);
  }
};

}  // namespace knead
