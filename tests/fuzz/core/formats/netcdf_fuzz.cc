// netCDF, classic and netCDF-4, and MINC 1, in the process of its library.

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/match.h"

#include "netcdf.h"
#include "tests/fuzz/core/formats/open_volume.h"
#include "tests/fuzz/fuzz_input.h"

namespace isoscope::fuzz {
namespace {

std::string File(int mode) {
  int file = 0;
  Require(nc_create(InVolumeFolder("seed.nc").c_str(), NC_CLOBBER | mode, &file) == NC_NOERR,
          "the library writes seeds");
  std::array<int, 4> dimensions{};
  constexpr std::array<const char*, 4> kNames{"time", "z", "y", "x"};
  for (std::size_t i = 0; i < 4; ++i) {
    nc_def_dim(file, kNames[i], i == 0 ? NC_UNLIMITED : 2 + i, &dimensions[i]);
  }
  int z = 0;
  int p = 0;
  nc_def_var(file, "z", NC_FLOAT, 1, &dimensions[1], &z);
  nc_put_att_text(file, z, "positive", 4, "down");
  nc_def_var(file, "p", NC_SHORT, 4, dimensions.data(), &p);
  const double scale = 0.5;
  nc_put_att_double(file, p, "scale_factor", NC_DOUBLE, 1, &scale);
  nc_enddef(file);
  const std::array<float, 3> coordinates{1, 2, 3};
  nc_put_var_float(file, z, coordinates.data());
  const std::array<std::size_t, 4> start{};
  const std::array<std::size_t, 4> count{2, 3, 4, 5};
  const std::vector<short> samples(120, 7);
  nc_put_vara_short(file, p, start.data(), count.data(), samples.data());
  nc_close(file);
  return ReadVolumeFile("seed.nc");
}

std::string MincFile() {
  int file = 0;
  Require(nc_create(InVolumeFolder("seed.nc").c_str(), NC_CLOBBER, &file) == NC_NOERR,
          "the library writes seeds");
  std::array<int, 4> dimensions{};
  constexpr std::array<const char*, 4> kNames{"time", "zspace", "yspace", "xspace"};
  const double step = 1.5;
  for (std::size_t i = 0; i < 4; ++i) {
    int axis = 0;
    nc_def_dim(file, kNames[i], 2 + i, &dimensions[i]);
    nc_def_var(file, kNames[i], NC_INT, 0, nullptr, &axis);
    nc_put_att_double(file, axis, "step", NC_DOUBLE, 1, &step);
  }
  std::array<int, 3> variables{};
  nc_def_var(file, "image", NC_BYTE, 4, dimensions.data(), &variables[0]);
  nc_put_att_text(file, variables[0], "signtype", 8, "unsigned");
  nc_def_var(file, "image-min", NC_DOUBLE, 2, dimensions.data(), &variables[1]);
  nc_def_var(file, "image-max", NC_DOUBLE, 2, dimensions.data(), &variables[2]);
  nc_enddef(file);
  const std::vector<signed char> samples(120, 7);
  const std::vector<double> limits(6, 2.5);
  nc_put_var_schar(file, variables[0], samples.data());
  nc_put_var_double(file, variables[2], limits.data());
  nc_close(file);
  return ReadVolumeFile("seed.nc");
}

}  // namespace

std::vector<std::string> Seeds() {
  return {File(0), File(NC_64BIT_OFFSET), File(NC_64BIT_DATA), File(NC_NETCDF4), MincFile()};
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isoscope::fuzz;
  const auto bytes = Input(data, size).Rest();
  const char* const name = absl::StrContains(bytes, "space") ? "v.mnc" : "v.nc";
  WriteVolumeFile(name, bytes);
  OpenAndReadSeries(InVolumeFolder(name));
  return 0;
}
