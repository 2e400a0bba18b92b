// HDF5, read by the library: what is checked is our way of asking it, and that its errors stay
// errors.

#include <hdf5.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "tests/fuzz/core/formats/open_volume.h"
#include "tests/fuzz/fuzz_input.h"

namespace isoscope::fuzz {
namespace {

void PutNumbers(hid_t object, const char* name, const std::vector<double>& numbers) {
  const hsize_t count = numbers.size();
  const hid_t space = H5Screate_simple(1, &count, nullptr);
  const hid_t opened = H5Acreate2(object, name, H5T_NATIVE_DOUBLE, space, H5P_DEFAULT, H5P_DEFAULT);
  H5Awrite(opened, H5T_NATIVE_DOUBLE, numbers.data());
  H5Aclose(opened);
  H5Sclose(space);
}

void PutTexts(hid_t object, const char* name, const std::string& bytes, std::size_t size) {
  const hsize_t count = bytes.size() / size;
  const hid_t type = H5Tcopy(H5T_C_S1);
  H5Tset_size(type, size);
  const hid_t space = H5Screate_simple(1, &count, nullptr);
  const hid_t opened = H5Acreate2(object, name, type, space, H5P_DEFAULT, H5P_DEFAULT);
  H5Awrite(opened, type, bytes.data());
  H5Aclose(opened);
  H5Sclose(space);
  H5Tclose(type);
}

// A file of one array p, 3 x 4 x 5, with the attributes of VTKHDF and of openPMD.
std::string MeshSeed(const char* root, const char* attribute, const std::string& text,
                     const char* folder) {
  const hid_t file =
      H5Fcreate(InVolumeFolder("seed.h5").c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
  const hid_t links = H5Pcreate(H5P_LINK_CREATE);
  H5Pset_create_intermediate_group(links, 1);
  const hid_t group = H5Gcreate2(file, folder, links, H5P_DEFAULT, H5P_DEFAULT);
  const hid_t top = H5Oopen(file, root, H5P_DEFAULT);
  PutTexts(top, attribute, text, text.size());
  PutNumbers(top, "WholeExtent", {0, 4, 0, 3, 0, 2});
  const hsize_t dims[] = {3, 4, 5};
  const hid_t space = H5Screate_simple(3, dims, nullptr);
  const hid_t dataset =
      H5Dcreate2(group, "p", H5T_STD_U8LE, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
  PutTexts(dataset, "axisLabels", "zyx", 1);
  PutNumbers(dataset, "gridSpacing", {4, 2, 1});
  H5Dclose(dataset);
  H5Sclose(space);
  H5Oclose(top);
  H5Gclose(group);
  H5Pclose(links);
  H5Fclose(file);
  return ReadVolumeFile("seed.h5");
}

}  // namespace

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
  seeds.push_back(MeshSeed("VTKHDF", "Type", "ImageData", "VTKHDF/PointData"));
  seeds.push_back(MeshSeed("/", "openPMD", "1.1.0", "/data/1/meshes"));
  return seeds;
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isoscope::fuzz;
  WriteVolumeFile("v.h5", Input(data, size).Rest());
  OpenAndReadSeries(InVolumeFolder("v.h5"));
  return 0;
}
