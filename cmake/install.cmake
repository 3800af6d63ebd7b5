# Makes find_package(stipple) work from an installed tree.
include(CMakePackageConfigHelpers)
set(stipple_config_dir ${CMAKE_INSTALL_LIBDIR}/cmake/stipple)
configure_package_config_file(${CMAKE_CURRENT_SOURCE_DIR}/cmake/stipple-config.cmake.in
    ${CMAKE_CURRENT_BINARY_DIR}/stipple-config.cmake INSTALL_DESTINATION ${stipple_config_dir})
write_basic_package_version_file(${CMAKE_CURRENT_BINARY_DIR}/stipple-config-version.cmake COMPATIBILITY SameMinorVersion)
install(EXPORT stipple-targets NAMESPACE stipple:: DESTINATION ${stipple_config_dir})
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/stipple-config.cmake ${CMAKE_CURRENT_BINARY_DIR}/stipple-config-version.cmake
        DESTINATION ${stipple_config_dir})
install(FILES ${CMAKE_CURRENT_SOURCE_DIR}/LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR})
