# Flags of the sources that are compiled once per instruction set (kernels/loop/loop_simd.h). Elsewhere than on x86-64 these sources are empty.
if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64|amd64")
  set_source_files_properties(${CMAKE_CURRENT_LIST_DIR}/loop/loop_simd_avx2.cpp ${CMAKE_CURRENT_LIST_DIR}/equilibrium/energy_simd_avx2.cpp PROPERTIES COMPILE_OPTIONS "-mavx2;-mfma")
  set_source_files_properties(${CMAKE_CURRENT_LIST_DIR}/loop/loop_simd_avx512.cpp ${CMAKE_CURRENT_LIST_DIR}/equilibrium/energy_simd_avx512.cpp PROPERTIES COMPILE_OPTIONS "-mavx512f;-mavx512vl;-mavx512dq;-mavx512bw;-mavx2;-mfma")
  set_source_files_properties(${CMAKE_CURRENT_LIST_DIR}/simd_level.cpp PROPERTIES COMPILE_DEFINITIONS KNEAD_X86_LEVELS)
endif()
