#include "core/source/hdf5/hdf5_path.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "absl/strings/string_view.h"

#include "core/io/file.h"
#include "core/io/mounted_file.h"
#include "core/source/bytes/part_path.h"

namespace isoscope::source {
namespace {

// Names that say how an HDF5 file is to be read.
bool IsOfFormatInHdf5(const std::string& path) {
  PartPath parts;
  return SplitPartPath(path, NetcdfEndings(), &parts) || SplitPartPath(path, MincEndings(), &parts);
}

}  // namespace

const std::vector<std::string>& NetcdfEndings() {
  static const auto* const endings = new std::vector<std::string>{".nc", ".nc4", ".cdf", ".netcdf"};
  return *endings;
}

const std::vector<std::string>& MincEndings() {
  static const auto* const endings = new std::vector<std::string>{".mnc"};
  return *endings;
}

bool IsHdf5File(const std::string& path) {
  constexpr absl::string_view kSignature("\x89HDF\r\n\x1a\n", 8);
  constexpr std::int64_t kFirstUserBlock = 512;
  const auto file = io::OpenRandomAccessFile(path);
  if (!file.ok()) {
    return false;
  }
  std::array<char, kSignature.size()> bytes{};
  // At an address each look costs a round trip: only the first ones, which are read at once.
  constexpr std::int64_t kMaxFarUserBlock = std::int64_t{1} << 15;
  const std::int64_t size = io::IsMounted(path) ? std::min((*file)->size_bytes(), kMaxFarUserBlock)
                                                : (*file)->size_bytes();
  const std::int64_t end = size - static_cast<std::int64_t>(bytes.size());
  for (std::int64_t offset = 0; offset <= end;
       offset = offset == 0 ? kFirstUserBlock : 2 * offset) {
    if (!(*file)->ReadAt(offset, bytes.size(), bytes.data()).ok()) {
      return false;
    }
    if (absl::string_view(bytes.data(), bytes.size()) == kSignature) {
      return true;
    }
  }
  return false;
}

bool SplitHdf5Path(const std::string& path, Hdf5Path* parts) {
  PartPath split;
  if (SplitPartPath(path, {".h5", ".hdf5", ".he5", ".hdf", ".vtkhdf", ".ims"}, &split)) {
    *parts = {split.file, split.part};
    return true;
  }
  if (IsOfFormatInHdf5(path)) {
    return false;
  }
  if (io::PathExists(path)) {
    *parts = {path, ""};
    return IsHdf5File(path);
  }
  for (std::size_t colon = path.find(':'); colon != std::string::npos;
       colon = path.find(':', colon + 1)) {
    if (colon + 1 < path.size() && IsHdf5File(path.substr(0, colon))) {
      *parts = {path.substr(0, colon), path.substr(colon + 1)};
      return true;
    }
  }
  return false;
}

}  // namespace isoscope::source
