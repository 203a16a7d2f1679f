# `cmake --install`: the library, its public headers as <knead/graph/evaluator.h>, and what find_package(knead) and pkg-config read. The program installs
# itself in app/. Two components, which become packages (cmake/package.cmake): `knead` is what programs need to run, `dev` what they are built with.
include(CMakePackageConfigHelpers)
set(KNEAD_CONFIG_DIR ${CMAKE_INSTALL_LIBDIR}/cmake/knead)

install(TARGETS knead EXPORT kneadTargets LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT knead NAMELINK_COMPONENT dev
        ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT dev RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT knead)
install(EXPORT kneadTargets NAMESPACE knead:: DESTINATION ${KNEAD_CONFIG_DIR} COMPONENT dev)
install(FILES LICENSE NOTICE DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT knead)

# What a program outside may include. The engine's other headers are the compiler's, the evaluator's and the devices' own.
set(KNEAD_PUBLIC_HEADERS
    graph/api.h graph/buffer.h graph/cache.h graph/cancel.h graph/device_code.h graph/error.h graph/evaluator.h graph/executor.h graph/hash.h
    graph/literal.h graph/node.h graph/opaque_value.h graph/param.h graph/plan.h graph/registry.h graph/report.h graph/spec.h graph/value.h
    kernels/neighbour_table.h kernels/parallel.h kernels/port_types.h kernels/shapes/primitives.h kernels/vec.h
    io/files.h io/graph_file.h io/libraries.h io/mesh/mesh_io.h io/schema.h io/stats.h)
if(KNEAD_PICTURES)
  list(APPEND KNEAD_PUBLIC_HEADERS io/picture/picture.h)
endif()

# Build trees have the same names: headers that lead to the source tree, and <knead/knead.h>, which includes all.
set(all_headers "// All of Knead's public headers.\n#pragma once\n")
foreach(header ${KNEAD_PUBLIC_HEADERS})
  string(APPEND all_headers "#include <knead/${header}>\n")
  file(CONFIGURE OUTPUT ${CMAKE_CURRENT_BINARY_DIR}/include/knead/${header} CONTENT "#include \"${CMAKE_CURRENT_SOURCE_DIR}/${header}\"\n")
endforeach()
file(CONFIGURE OUTPUT ${CMAKE_CURRENT_BINARY_DIR}/include/knead/knead.h CONTENT "${all_headers}")

# Installed headers include each other as <knead/...>, so that nothing of a stranger's own graph/ or io/ is taken for Knead's.
install(CODE "
  foreach(header ${KNEAD_PUBLIC_HEADERS})
    file(READ \"${CMAKE_CURRENT_SOURCE_DIR}/\${header}\" text)
    string(REGEX REPLACE \"#include \\\"((graph|kernels|io)/[^\\\"]*)\\\"\" \"#include <knead/\\\\1>\" text \"\${text}\")
    file(WRITE \"${CMAKE_CURRENT_BINARY_DIR}/installed_headers/knead/\${header}\" \"\${text}\")
  endforeach()" COMPONENT dev)
install(DIRECTORY ${CMAKE_CURRENT_BINARY_DIR}/installed_headers/knead DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT dev)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/include/knead/knead.h DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/knead COMPONENT dev)

configure_package_config_file(cmake/kneadConfig.cmake.in ${CMAKE_CURRENT_BINARY_DIR}/kneadConfig.cmake INSTALL_DESTINATION ${KNEAD_CONFIG_DIR})
write_basic_package_version_file(${CMAKE_CURRENT_BINARY_DIR}/kneadConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/kneadConfig.cmake ${CMAKE_CURRENT_BINARY_DIR}/kneadConfigVersion.cmake cmake/FindOpenVDB.cmake
        DESTINATION ${KNEAD_CONFIG_DIR} COMPONENT dev)

# knead.pc tells its prefix from where it stands, so that an installed copy may be moved.
file(RELATIVE_PATH KNEAD_PREFIX_FROM_PC ${CMAKE_INSTALL_FULL_LIBDIR}/pkgconfig ${CMAKE_INSTALL_PREFIX})
if(NOT BUILD_SHARED_LIBS)
  set(KNEAD_PC_LIBRARIES "-lopenvdb -lImath-3_1 -lembree3 -lyaml-cpp -lfmt -ltbb -lpng -ldl -lpthread")
endif()
configure_file(cmake/knead.pc.in ${CMAKE_CURRENT_BINARY_DIR}/knead.pc @ONLY)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/knead.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT dev)
