#include "core/source/refused_formats.h"

#include <algorithm>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

#include "core/io/file.h"

namespace isoscope::source {
namespace {

struct RefusedFormat {
  const char* name;
  std::vector<std::string> endings;
  const char* advice;
  std::vector<std::string> in_folder{};  // a folder with such a file is of this format
};

const std::vector<RefusedFormat>& RefusedFormats() {
  static const auto* const formats = new std::vector<RefusedFormat>{
      {.name = "N5",
       .endings = {".n5", "attributes.json"},
       .advice = "save the dataset as HDF5 or as TIFF slices, as Fiji does",
       .in_folder = {"attributes.json"}},
      {.name = "Zarr",
       .endings = {".zarr", ".zarray", ".zgroup", "zarr.json"},
       .advice = "save the array as HDF5 or as TIFF slices, as Fiji and h5py do",
       .in_folder = {".zarray", ".zgroup", "zarr.json"}},
      {.name = "a VTK grid that is not regular, or a mesh",
       .endings = {".vtu", ".vts", ".vtp", ".vtm", ".pvtu", ".pvts", ".pvtp", ".pvtr"},
       .advice =
           "resample it, as ParaView's filter \"Resample To Image\" does, and save it as .vti"},
      {.name = "a microscope's own format",
       .endings = {".czi", ".lif", ".nd2", ".oib", ".oif", ".vsi"},
       .advice = "convert it to OME-TIFF, as bfconvert of Bio-Formats does"},
      {.name = "MINC as a gzip stream", .endings = {".mnc.gz"}, .advice = "decompress it (gunzip)"},
  };
  return *formats;
}

bool IsOf(const RefusedFormat& format, const std::string& path) {
  const auto in_folder = [&](const std::string& name) {
    return io::PathExists(absl::StrCat(path, "/", name));
  };
  return std::any_of(
             format.endings.begin(), format.endings.end(),
             [&](const std::string& ending) { return absl::EndsWithIgnoreCase(path, ending); }) ||
         std::any_of(format.in_folder.begin(), format.in_folder.end(), in_folder);
}

}  // namespace

std::optional<std::string> WhyRefused(const std::string& path) {
  std::string name = path;
  while (name.size() > 1 && name.back() == '/') {
    name.pop_back();
  }
  for (const RefusedFormat& format : RefusedFormats()) {
    if (IsOf(format, name)) {
      return absl::StrCat(format.name, ", which is not read: ", format.advice);
    }
  }
  return std::nullopt;
}

}  // namespace isoscope::source
