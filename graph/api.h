// What libknead shows to programs outside. Everything else is hidden: the library is compiled with -fvisibility=hidden, and cmake/exports.map keeps back
// what other libraries' headers leave in its objects. Tests see all, since they are linked with the objects themselves.
#pragma once

#define KNEAD_API __attribute__((visibility("default")))
