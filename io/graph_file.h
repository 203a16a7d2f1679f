// Graph files: YAML 1.2 (which holds JSON) to literals that know their line and column, and from there to graphs.
#pragma once
#include <string>

#include "graph/literal.h"
#include "graph/plan.h"
#include "graph/spec.h"

namespace knead {

// The tree of a text, every literal with its place. Plain scalars follow YAML's core schema (null, true, 12, 0x1f, 1e-4, .inf); quoted ones stay
// texts. Anchors, aliases and merge keys (`<<`) work. Throws GraphErrors, named after `file`, for bad YAML, duplicate keys, more than one document,
// trees deeper than 100 levels and aliases that unfold to more than a million literals.
KNEAD_API Literal parse_yaml(const std::string& text, const std::string& file);

// Reads a graph file. Relative `path` arguments of its nodes are taken from the graph file's folder, those of nodes named write_* from `out`
// (empty: the current directory). Paths that begin with $ are a group's parameters and stay. Throws GraphErrors, or Error(kFile) when it cannot be
// read.
KNEAD_API GraphSpec read_graph_file(const std::string& path, const std::string& out = {});

// The same for a text that is not in a file; `file` names it in errors and its folder is where relative paths begin.
KNEAD_API GraphSpec read_graph_text(const std::string& text, const std::string& file, const std::string& out = {});

// Options with which `group` nodes read their files through read_graph_file.
KNEAD_API CompileOptions graph_file_options(const std::string& out = {});

}  // namespace knead
