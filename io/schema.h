// What the node declarations say, for editors and for people: the JSON schema of graph files, the manual pages, the documentation's page of nodes.
#pragma once
#include <string>

#include "graph/registry.h"

namespace knead {

// A JSON schema (draft 7) of graph files that use the registry's node types, as indented text. yaml-language-server takes it as it is.
KNEAD_API std::string graph_schema(const Registry& registry);

// One node type's page: its manual, then its inputs, parameters and outputs as declared.
KNEAD_API std::string manual_page(const NodeType& type);

// The first sentence of the manual, on one line and without its full stop.
KNEAD_API std::string node_title(const NodeType& type);

// "read_mesh   Reads a mesh ...", a line for every type.
KNEAD_API std::string node_list(const Registry& registry);

// docs/nodes.md: a table of all node types (name, what it does, inputs, outputs), then every type's page.
KNEAD_API std::string nodes_markdown(const Registry& registry);

}  // namespace knead
