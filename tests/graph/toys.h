// Toys for tests of the engine: all of them in one registry.
#pragma once
#include <memory>

#include "graph/registry.h"
#include "tests/graph/toy_device_nodes.h"
#include "tests/graph/toy_nodes.h"
#include "tests/graph/toy_values.h"

namespace knead {
namespace toys {

template <class T>
void put(Registry& registry, const char* name, int version = 1) {
  registry.add({name, version, "A toy.", [] { return std::unique_ptr<Node>(std::make_unique<T>()); }, {}});
}

inline const Registry& registry() {
  static const Registry all = [] {
    Registry r;
    register_iterate(r);
    register_group(r);
    put<ValueNode>(r, "value");
    put<Add>(r, "add");
    put<Sum>(r, "sum");
    put<Count>(r, "count");
    put<FrameNode>(r, "frame");
    put<Spell>(r, "spell");
    put<FileNode>(r, "file");
    put<WriteNode>(r, "write");
    put<Failing>(r, "failing");
    put<Greedy>(r, "greedy");
    put<Sleepy>(r, "sleepy");
    put<Warns>(r, "warns");
    put<Shares>(r, "shares");
    put<SlyFrame>(r, "sly_frame");
    put<SlyGlobal>(r, "sly_global");
    put<SlyOnce>(r, "sly_once");
    put<SlyWrite>(r, "sly_write");
    put<Forgets>(r, "forgets");
    put<DeviceAdd>(r, "device_add");
    put<DevicePeek>(r, "device_peek");
    put<Relax>(r, "relax");
    put<Tally>(r, "tally");
    put<Explode>(r, "explode");
    put<Spread>(r, "spread");
    put<DeviceTables>(r, "placed");
    put<Grow>(r, "grow");
    put<Peek>(r, "peek");
    put<Break>(r, "break");
    return r;
  }();
  return all;
}

inline CompileOptions options() {
  CompileOptions made;
  made.registry = &registry();
  return made;
}

}  // namespace toys
}  // namespace knead
