// netCDF files of known values.

#ifndef ISOSCOPE_TESTS_UNIT_CORE_FORMATS_NETCDF_NETCDF_BYTES_H_
#define ISOSCOPE_TESTS_UNIT_CORE_FORMATS_NETCDF_NETCDF_BYTES_H_

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

#include "netcdf.h"

namespace isoscope::testing {

// Writes a file piece by piece; dimensions before variables.
class NetcdfWriter {
 public:
  NetcdfWriter(const std::string& path, int mode) {
    EXPECT_EQ(nc_create(path.c_str(), NC_CLOBBER | mode, &file_), NC_NOERR);
  }
  ~NetcdfWriter() { EXPECT_EQ(nc_close(file_), NC_NOERR); }
  NetcdfWriter(const NetcdfWriter&) = delete;
  NetcdfWriter& operator=(const NetcdfWriter&) = delete;

  // `size` 0: unlimited.
  int Dimension(const std::string& name, std::size_t size) {
    int id = 0;
    EXPECT_EQ(nc_def_dim(file_, name.c_str(), size, &id), NC_NOERR);
    return id;
  }
  // Of variables that follow: nothing is written but their values. netCDF-4.
  void LeaveUnfilled() { fills_ = false; }
  using Texts = std::vector<std::pair<std::string, std::string>>;
  using Numbers = std::vector<std::pair<std::string, double>>;
  // Values are converted from double; `count` elements on each dimension.
  void Variable(const std::string& name, nc_type type, const std::vector<int>& dimensions,
                const std::vector<std::size_t>& count, const std::vector<double>& values,
                const Texts& texts = {}, const Numbers& numbers = {},
                const std::vector<std::size_t>& chunk = {}) {
    int id = 0;
    nc_redef(file_);
    ASSERT_EQ(nc_def_var(file_, name.c_str(), type, static_cast<int>(dimensions.size()),
                         dimensions.data(), &id),
              NC_NOERR);
    if (!chunk.empty()) {
      EXPECT_EQ(nc_def_var_chunking(file_, id, NC_CHUNKED, chunk.data()), NC_NOERR);
      EXPECT_EQ(nc_def_var_deflate(file_, id, 1, 1, 4), NC_NOERR);
    }
    if (!fills_) {
      EXPECT_EQ(nc_def_var_fill(file_, id, NC_NOFILL, nullptr), NC_NOERR);
    }
    for (const auto& [key, text] : texts) {
      EXPECT_EQ(nc_put_att_text(file_, id, key.c_str(), text.size(), text.c_str()), NC_NOERR);
    }
    for (const auto& [key, number] : numbers) {
      const bool is_packed = key == "scale_factor" || key == "add_offset";
      EXPECT_EQ(nc_put_att_double(file_, id, key.c_str(), is_packed ? NC_DOUBLE : type, 1, &number),
                NC_NOERR);
    }
    nc_enddef(file_);
    const std::vector<std::size_t> start(count.size(), 0);
    EXPECT_EQ(nc_put_vara_double(file_, id, start.data(), count.data(), values.data()), NC_NOERR);
  }

  // Gives a variable an attribute of several numbers.
  void Attribute(const std::string& variable, const std::string& key,
                 const std::vector<double>& numbers) {
    int id = 0;
    nc_redef(file_);
    ASSERT_EQ(nc_inq_varid(file_, variable.c_str(), &id), NC_NOERR);
    EXPECT_EQ(nc_put_att_double(file_, id, key.c_str(), NC_DOUBLE, numbers.size(), numbers.data()),
              NC_NOERR);
    nc_enddef(file_);
  }

 private:
  int file_ = 0;
  bool fills_ = true;
};

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_UNIT_CORE_FORMATS_NETCDF_NETCDF_BYTES_H_
