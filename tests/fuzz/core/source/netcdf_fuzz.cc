// netCDF, classic and netCDF-4, in the process of its library.

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "netcdf.h"
#include "tests/fuzz/core/source/open_volume.h"
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

}  // namespace

std::vector<std::string> Seeds() {
  return {File(0), File(NC_64BIT_OFFSET), File(NC_64BIT_DATA), File(NC_NETCDF4)};
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isoscope::fuzz;
  WriteVolumeFile("v.nc", Input(data, size).Rest());
  OpenAndReadSeries(InVolumeFolder("v.nc"));
  return 0;
}
