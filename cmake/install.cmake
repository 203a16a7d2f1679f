# `cmake --install`: the library, its public headers under include/knead, and what find_package(knead) reads. The program installs itself in app/.
include(CMakePackageConfigHelpers)
set(KNEAD_CONFIG_DIR ${CMAKE_INSTALL_LIBDIR}/cmake/knead)

install(TARGETS knead EXPORT kneadTargets LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
install(EXPORT kneadTargets NAMESPACE knead:: DESTINATION ${KNEAD_CONFIG_DIR})

file(GLOB graph_headers CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/graph/*.h)
list(FILTER graph_headers EXCLUDE REGEX "/(iterate|frame_context|plan_values|loop|device_executor)\\.h$") # the compiler's and the evaluator's own
install(FILES ${graph_headers} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/knead/graph)
foreach(header vec port_types neighbour_table parallel)
  install(FILES kernels/${header}.h DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/knead/kernels)
endforeach()
foreach(header files graph_file libraries schema stats)
  install(FILES io/${header}.h DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/knead/io)
endforeach()
install(FILES io/mesh/mesh_io.h DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/knead/io/mesh)
if(KNEAD_PICTURES)
  install(FILES io/picture/picture.h DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/knead/io/picture)
endif()

configure_package_config_file(cmake/kneadConfig.cmake.in ${CMAKE_CURRENT_BINARY_DIR}/kneadConfig.cmake INSTALL_DESTINATION ${KNEAD_CONFIG_DIR})
write_basic_package_version_file(${CMAKE_CURRENT_BINARY_DIR}/kneadConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/kneadConfig.cmake ${CMAKE_CURRENT_BINARY_DIR}/kneadConfigVersion.cmake cmake/FindOpenVDB.cmake DESTINATION ${KNEAD_CONFIG_DIR})
