// Two node types of this program's own, made with the installed headers only.
#pragma once
#include <knead/knead.h>

// Adds them to a registry, usually a copy of knead::Registry::builtin().
//   host_mesh   gives `mesh`, which lives in this program's memory, to graphs
//   ripple      lets waves run over a surface, frame by frame
void add_own_nodes(knead::Registry& registry, knead::Surface mesh);
