// HDF5, read by the library: what is checked is our way of asking it, and that its errors stay
// errors.

#include <hdf5.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "tests/fuzz/core/source/open_volume.h"
#include "tests/fuzz/fuzz_input.h"

namespace isoscope::fuzz {

std::vector<std::string> Seeds() {
  std::vector<std::string> seeds;
  const std::string samples(480, 'a');
  const hsize_t dims[] = {3, 4, 5};
  const hsize_t chunk[] = {2, 2, 5};
  for (const hid_t type : {H5T_STD_U8LE, H5T_STD_I16BE, H5T_IEEE_F32LE, H5T_STD_I64LE}) {
    for (const bool is_chunked : {false, true}) {
      const std::string path = InVolumeFolder("seed.h5");
      const hid_t file = H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
      const hid_t space = H5Screate_simple(3, dims, nullptr);
      const hid_t properties = H5Pcreate(H5P_DATASET_CREATE);
      if (is_chunked) {
        H5Pset_chunk(properties, 3, chunk);
        H5Pset_deflate(properties, 4);
      }
      const hid_t dataset =
          H5Dcreate2(file, "v", type, space, H5P_DEFAULT, properties, H5P_DEFAULT);
      Require(H5Dwrite(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, samples.data()) >= 0,
              "a seed can be written");
      H5Dclose(dataset);
      H5Pclose(properties);
      H5Sclose(space);
      H5Fclose(file);
      seeds.push_back(ReadVolumeFile("seed.h5"));
    }
  }
  return seeds;
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isoscope::fuzz;
  WriteVolumeFile("v.h5", Input(data, size).Rest());
  OpenAndReadVolume(InVolumeFolder("v.h5"));
  return 0;
}
