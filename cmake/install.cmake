# SPDX-License-Identifier: MIT
# cmake --install, and `cpack -G DEB` for a Debian package.
include(GNUInstallDirs)
set(CMAKE_SKIP_INSTALL_ALL_DEPENDENCY ON)  # A package needs the programs, not every test.
install(TARGETS rig rig-sim RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
install(DIRECTORY procedures/ DESTINATION ${CMAKE_INSTALL_DATADIR}/rig/procedures)
install(FILES README.md CHANGELOG.md CONTRIBUTING.md LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR})
install(DIRECTORY sim/worlds DESTINATION ${CMAKE_INSTALL_DATADIR}/rig)
install(DIRECTORY docs/ DESTINATION ${CMAKE_INSTALL_DOCDIR}/docs FILES_MATCHING PATTERN "*.md" PATTERN "*.png" PATTERN "*.svg" PATTERN "*.json" PATTERN "*.hpp" PATTERN "*.py" PATTERN "*.cpp" PATTERN "man" EXCLUDE)
install(DIRECTORY docs/man/ DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 FILES_MATCHING PATTERN "*.1")
install(FILES scripts/packaging/rig.bash-completion DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions RENAME rig)
install(FILES scripts/packaging/60-rig.rules DESTINATION lib/udev/rules.d)
install(FILES scripts/packaging/rig-sim.service DESTINATION ${CMAKE_INSTALL_DOCDIR}/examples)

# The driver for programs of one's own: g++ -std=c++20 mine.cpp -llidar -pthread (docs/develop/lidar.md).
install(TARGETS lidar ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
install(DIRECTORY lidar/ DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/lidar FILES_MATCHING PATTERN "*.hpp")

set(CPACK_PACKAGE_NAME rig-calibration)
set(CPACK_PACKAGE_VENDOR "rig")
set(CPACK_PACKAGE_CONTACT "maintainers <maintainers@users.noreply.example>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "Calibration rig controller for scanning lidars on a rotary stage")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_GENERATOR DEB)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_DEPENDS "gnuplot-nox")
set(CPACK_DEBIAN_PACKAGE_RECOMMENDS "weasyprint")
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_STRIP_FILES ON)
include(CPack)
