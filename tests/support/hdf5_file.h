// HDF5 files of known values, with attributes and scales as h5py and netCDF-4 write them.

#ifndef ISOSCOPE_TESTS_SUPPORT_HDF5_FILE_H_
#define ISOSCOPE_TESTS_SUPPORT_HDF5_FILE_H_

#include <algorithm>
#include <cstddef>
#include <string>
#include <vector>

#include "gtest/gtest.h"

#include "hdf5.h"

namespace isoscope::testing {

// Chunked if `chunk` is not empty.
inline void WriteHdf5Dataset(hid_t file, const std::string& name, const std::vector<hsize_t>& dims,
                             hid_t type, const void* samples,
                             const std::vector<hsize_t>& chunk = {}) {
  const hid_t space = H5Screate_simple(static_cast<int>(dims.size()), dims.data(), nullptr);
  const hid_t properties = H5Pcreate(H5P_DATASET_CREATE);
  if (!chunk.empty()) {
    H5Pset_chunk(properties, static_cast<int>(chunk.size()), chunk.data());
    H5Pset_deflate(properties, 4);
  }
  const hid_t dataset =
      H5Dcreate2(file, name.c_str(), type, space, H5P_DEFAULT, properties, H5P_DEFAULT);
  ASSERT_GE(dataset, 0);
  ASSERT_GE(H5Dwrite(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, samples), 0);
  H5Dclose(dataset);
  H5Pclose(properties);
  H5Sclose(space);
}

// Texts of any length, or of one of 16 bytes, on a dataset or a group.
inline void WriteHdf5Texts(hid_t file, const std::string& name, const std::string& attribute,
                           const std::vector<std::string>& texts, bool is_fixed = false) {
  const hid_t object = H5Oopen(file, name.c_str(), H5P_DEFAULT);
  const hid_t type = H5Tcopy(H5T_C_S1);
  H5Tset_size(type, is_fixed ? 16 : H5T_VARIABLE);
  const hsize_t count = texts.size();
  const hid_t space = count == 1 ? H5Screate(H5S_SCALAR) : H5Screate_simple(1, &count, nullptr);
  const hid_t opened = H5Acreate2(object, attribute.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT);
  std::vector<const char*> pointers;
  std::string bytes;
  for (const std::string& text : texts) {
    pointers.push_back(text.c_str());
    bytes += text + std::string(16 - std::min<std::size_t>(text.size(), 16), '\0');
  }
  ASSERT_GE(H5Awrite(opened, type,
                     is_fixed ? static_cast<const void*>(bytes.data())
                              : static_cast<const void*>(pointers.data())),
            0);
  H5Aclose(opened);
  H5Sclose(space);
  H5Tclose(type);
  H5Oclose(object);
}

// Numbers, on a dataset or a group.
inline void WriteHdf5Numbers(hid_t file, const std::string& name, const std::string& attribute,
                             const std::vector<double>& numbers) {
  const hid_t object = H5Oopen(file, name.c_str(), H5P_DEFAULT);
  const hsize_t count = numbers.size();
  const hid_t space = count == 1 ? H5Screate(H5S_SCALAR) : H5Screate_simple(1, &count, nullptr);
  const hid_t opened =
      H5Acreate2(object, attribute.c_str(), H5T_IEEE_F64LE, space, H5P_DEFAULT, H5P_DEFAULT);
  ASSERT_GE(H5Awrite(opened, H5T_NATIVE_DOUBLE, numbers.data()), 0);
  H5Aclose(opened);
  H5Sclose(space);
  H5Oclose(object);
}

// DIMENSION_LIST: the names of scales by axis, "" for none.
inline void WriteHdf5Scales(hid_t file, const std::string& dataset,
                            const std::vector<std::string>& scales) {
  const hid_t object = H5Dopen2(file, dataset.c_str(), H5P_DEFAULT);
  const hid_t type = H5Tvlen_create(H5T_STD_REF_OBJ);
  const hsize_t count = scales.size();
  const hid_t space = H5Screate_simple(1, &count, nullptr);
  std::vector<hobj_ref_t> references(scales.size());
  std::vector<hvl_t> lists(scales.size());
  for (std::size_t axis = 0; axis < scales.size(); ++axis) {
    lists[axis] = {scales[axis].empty() ? 0U : 1U, &references[axis]};
    if (!scales[axis].empty()) {
      ASSERT_GE(H5Rcreate(&references[axis], file, scales[axis].c_str(), H5R_OBJECT, -1), 0);
    }
  }
  const hid_t opened = H5Acreate2(object, "DIMENSION_LIST", type, space, H5P_DEFAULT, H5P_DEFAULT);
  ASSERT_GE(H5Awrite(opened, type, lists.data()), 0);
  H5Aclose(opened);
  H5Sclose(space);
  H5Tclose(type);
  H5Dclose(object);
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_HDF5_FILE_H_
