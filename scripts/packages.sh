# The Debian 12 packages that Isoscope needs, in one place. Source it; it runs nothing by itself:
#
#   . scripts/packages.sh
#   install_packages "${ISOSCOPE_BUILD_PACKAGES[@]}" "${ISOSCOPE_TEST_PACKAGES[@]}"
#
# The container images and CONTRIBUTING.md take their lists from here:
#
#   bash -c '. scripts/packages.sh && echo "${ISOSCOPE_BUILD_PACKAGES[@]}"'

# Packages to build and run the programs.
ISOSCOPE_BUILD_PACKAGES=(
  build-essential cmake ninja-build ccache pkg-config ca-certificates python3
  libgrpc++-dev libprotobuf-dev protobuf-compiler protobuf-compiler-grpc libabsl-dev
  libtbb-dev libhwy-dev libzstd-dev liblz4-dev libpng-dev libjpeg62-turbo-dev libisal-dev liburing-dev libssl-dev
  libcurl4-openssl-dev
  libspdlog-dev libcli11-dev nlohmann-json3-dev libboost1.81-dev
  libepoxy-dev libegl-dev libgl-dev libegl1 libgl1-mesa-dri
  libinsighttoolkit5-dev libhdf5-dev libnetcdf-dev libtiff-dev libopenjp2-7-dev libexpat1-dev libbz2-dev libblosc-dev
  zlib1g-dev liblzma-dev libopenvdb-dev
  libwebp-dev libsixel-dev libmeshoptimizer-dev libpango1.0-dev fonts-dejavu-core
)

# Packages to run the programs in the container images: all four programs; those that draw (isoscope-agent and
# isoscope); isoscope, which reads volumes and writes pictures; and isoscope-gateway. Omitted are packages that these or
# dpkg depend on anyway (libabsl, libbz2-1.0, libfmt9, libprotobuf32, libssl3, libzstd1, zlib1g).
ISOSCOPE_RUNTIME_PACKAGES=(
  libgrpc++1.51 libspdlog1.10 libtbb12 libpng16-16 libjpeg62-turbo libisal2 libhwy1 liblz4-1 liburing2)
ISOSCOPE_RENDERING_PACKAGES=(libepoxy0 libegl1 libopengl0 libgl1-mesa-dri)
ISOSCOPE_SOURCE_PACKAGES=(libinsighttoolkit5.2 libhdf5-103-1 libnetcdf19 libtiff6 libopenjp2-7 libexpat1 libblosc1
  libcurl4 ca-certificates libwebp7 libwebpmux3 libsixel1 libmeshoptimizer2d libpangocairo-1.0-0 fonts-dejavu-core
  hdf5-filter-plugin hdf5-filter-plugin-blosc-serial hdf5-filter-plugin-zfp-serial hdf5-plugin-lzf)
# The gateway's own: it writes meshes and draws annotations over pictures.
ISOSCOPE_GATEWAY_PACKAGES=(libmeshoptimizer2d libpangocairo-1.0-0 libwebp7 libwebpmux3 fonts-dejavu-core)
ISOSCOPE_VDB_PACKAGES=(libopenvdb10.0)

# Packages to build tests and benchmarks; to run the unit tests and the guards of the promises; to run the other tests:
# the Python client, shells, manuals.
ISOSCOPE_TEST_PACKAGES=(libgtest-dev libgmock-dev libbenchmark-dev lld)
ISOSCOPE_UNIT_TEST_PACKAGES=(git python3 openssl procps)
ISOSCOPE_CLIENT_TEST_PACKAGES=(
  python3-grpcio python3-protobuf python3-numpy python3-pytest python3-mypy python3-pip python3-setuptools
  python3-wheel python3-build python3-venv python3-dask python3-xarray python3-cloudpickle python3-nbconvert
  python3-zarr python3-fsspec python3-ipykernel python3-aiohttp zsh fish mandoc man-db)

# Packages of the tests of clients/web, some 700 MB with all dependencies. Tests whose program is missing are skipped
# with a message.
ISOSCOPE_BROWSER_PACKAGES=(nodejs node-typescript chromium chromium-driver python3-selenium)

# Packages that scripts/package_web.py needs.
ISOSCOPE_WEB_PACKAGES=(node-typescript protobuf-compiler python3-protobuf)

# Packages that the tests compare our files with, some 50 packages, 30 MB to download; and clang for locks and
# libFuzzer.
ISOSCOPE_REFERENCE_PACKAGES=(python3-vtk9 gnuplot-nox clang-14 python3-h5py python3-zarr hdf5-filter-plugin
  hdf5-filter-plugin-blosc-serial hdf5-filter-plugin-zfp-serial hdf5-plugin-lzf)

# A real Prometheus and promtool. It is a service: where systemd runs, installing it would start it, so there
# scripts/test.sh leaves that to you.
ISOSCOPE_SERVICE_PACKAGES=(prometheus)

# The MRI heads that the quick start and some tests use.
ISOSCOPE_DEMO_PACKAGES=(mricron-data)

# Packages of the tests of deploy/. Tests whose program is missing are skipped with a message. The types of Kubernetes'
# objects come from npm: tests/deploy/check_deploy.py.
ISOSCOPE_DEPLOY_PACKAGES=(python3-yaml shellcheck kubernetes-client docker-compose slurm-wlm slurm-client munge
  lintian mmdebstrap)

# Packages of the plots of `isoscope-bench paper`; its tables need none.
ISOSCOPE_PLOT_PACKAGES=(gnuplot-nox)

# Packages of tools/format.sh and tools/check.sh, and of the clang and fuzz presets.
ISOSCOPE_LINT_PACKAGES=(clang-format-14 clang-tidy-14 clang-14)

# Packages that scripts/package.sh needs in addition.
ISOSCOPE_PACKAGE_PACKAGES=(dpkg-dev python3-pip python3-setuptools python3-wheel)

# Prints those of the given packages that are not installed, one a line.
missing_packages() {
  local package
  for package in "$@"; do
    if [ "$(dpkg-query --show --showformat='${db:Status-Status}' "$package" 2>/dev/null)" != installed ]; then
      echo "$package"
    fi
  done
}

# Installs the missing ones of the given packages; needs no rights if all are installed.
install_packages() {
  if ! command -v dpkg-query >/dev/null; then
    echo "isoscope: this is no Debian system; install by your own means: $*" >&2
    return 1
  fi
  local names missing
  names="$(missing_packages "$@")"
  if [ -z "$names" ]; then
    return 0
  fi
  mapfile -t missing <<<"$names"
  local as_root=()
  if [ "$(id -u)" -ne 0 ]; then
    if ! command -v sudo >/dev/null; then
      echo "isoscope: these Debian packages are missing, and this is neither root nor is there sudo;" \
        "install them as root: apt-get install --no-install-recommends ${missing[*]}" >&2
      return 1
    fi
    as_root=(sudo)
    echo "isoscope: packages are installed as root, by sudo, which may ask for your password" >&2
  fi
  echo "isoscope: installing ${#missing[@]} Debian packages: ${missing[*]}" >&2
  "${as_root[@]}" apt-get update -qq </dev/null >&2 || return
  # Its status goes to a file opened after sudo, which closes all but three descriptors; maintainer scripts find that
  # file closed.
  # shellcheck disable=SC2016  # the inner shell expands
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive bash -c 'exec "$@" 3>&1' apt-get apt-get install -y -qq \
    --no-install-recommends -o Dpkg::Use-Pty=0 -o APT::Status-Fd=3 "${missing[@]}" </dev/null |
    show_apt_progress >&2
  return "${PIPESTATUS[0]}"
}

# Turns APT's lines of status into a line each ten seconds, and keeps its other lines.
show_apt_progress() {
  local kind percent text shown="$SECONDS"
  while IFS=: read -r kind _ percent text; do
    case "$kind" in
      dlstatus) ((SECONDS < shown + 10)) || echo "isoscope: packages: fetched ${percent%.*} %, ${text#*(}" | tr -d ')' ;;
      pmstatus) ((SECONDS < shown + 10)) || echo "isoscope: packages: installed ${percent%.*} %" ;;
      *) continue ;;
    esac
    ((SECONDS < shown + 10)) || shown="$SECONDS"
  done
}

# show_build_progress: shows ninja's lines of [finished/all, seconds] with an estimate of the remaining time: in place
# on a terminal, otherwise a line each ten seconds. Keeps the compilers' output.
show_build_progress() {
  local line done_count all_count elapsed left text shown=-10
  while IFS= read -r line; do
    if [[ ! "$line" =~ ^\[([0-9]+)/([0-9]+),\ ([0-9]+)[.0-9]*s\]\ (.*) ]]; then
      [ ! -t 1 ] || printf '\r\033[K'
      printf '%s\n' "$line"
      continue
    fi
    done_count="${BASH_REMATCH[1]}" all_count="${BASH_REMATCH[2]}" elapsed="${BASH_REMATCH[3]}"
    ((all_count >= 10)) || continue  # over at once
    left=$((done_count > 0 ? elapsed * (all_count - done_count) / done_count : 0))
    printf -v text '[%d of %d files, %d:%02d min, about %d:%02d left]' "$done_count" "$all_count" \
      $((elapsed / 60)) $((elapsed % 60)) $((left / 60)) $((left % 60))
    if [ -t 1 ]; then
      printf '\r\033[K%s' "$text"
      [ "$done_count" != "$all_count" ] || echo
    elif ((SECONDS >= shown + 10)) || [ "$done_count" = "$all_count" ]; then
      shown="$SECONDS"
      echo "$text"
    fi
  done
}
