// HDF5 files with groups and attributes, as VTKHDF and openPMD have them.

#ifndef ISOSCOPE_TESTS_SUPPORT_HDF5_MESH_FILE_H_
#define ISOSCOPE_TESTS_SUPPORT_HDF5_MESH_FILE_H_

#include <string>
#include <vector>

#include "hdf5.h"
#include "tests/support/hdf5_file.h"

namespace isoscope::testing {

class Hdf5MeshWriter {
 public:
  explicit Hdf5MeshWriter(const std::string& path)
      : file_(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT)) {}
  ~Hdf5MeshWriter() { H5Fclose(file_); }
  Hdf5MeshWriter(const Hdf5MeshWriter&) = delete;
  Hdf5MeshWriter& operator=(const Hdf5MeshWriter&) = delete;

  [[nodiscard]] hid_t file() const { return file_; }
  void Group(const std::string& path) {
    H5Gclose(H5Gcreate2(file_, path.c_str(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
  }
  void Texts(const std::string& path, const std::string& name,
             const std::vector<std::string>& texts) {
    const hid_t object = H5Oopen(file_, path.c_str(), H5P_DEFAULT);
    const hid_t type = H5Tcopy(H5T_C_S1);
    H5Tset_size(type, 32);
    std::string bytes;
    for (const std::string& text : texts) {
      bytes += text + std::string(32 - text.size(), '\0');
    }
    Put(object, name, type, texts.size(), bytes.data());
    H5Tclose(type);
    H5Oclose(object);
  }
  void Numbers(const std::string& path, const std::string& name,
               const std::vector<double>& numbers) {
    const hid_t object = H5Oopen(file_, path.c_str(), H5P_DEFAULT);
    Put(object, name, H5T_NATIVE_DOUBLE, numbers.size(), numbers.data());
    H5Oclose(object);
  }
  // A number of 32 bits.
  void Float(const std::string& path, const std::string& name, float number) {
    const hid_t object = H5Oopen(file_, path.c_str(), H5P_DEFAULT);
    Put(object, name, H5T_NATIVE_FLOAT, 1, &number);
    H5Oclose(object);
  }
  // A text as an array of single characters, as Imaris writes it.
  void Characters(const std::string& path, const std::string& name, const std::string& text) {
    const hid_t object = H5Oopen(file_, path.c_str(), H5P_DEFAULT);
    const hid_t type = H5Tcopy(H5T_C_S1);
    const hsize_t count = text.size();
    const hid_t space = H5Screate_simple(1, &count, nullptr);
    const hid_t opened = H5Acreate2(object, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT);
    ASSERT_GE(H5Awrite(opened, type, text.data()), 0);
    H5Aclose(opened);
    H5Sclose(space);
    H5Tclose(type);
    H5Oclose(object);
  }
  // Samples begin, begin + 1, ... of 32-bit floats.
  void Ramp(const std::string& path, const std::vector<hsize_t>& dims, float begin = 0) {
    hsize_t count = 1;
    for (const hsize_t size : dims) {
      count *= size;
    }
    std::vector<float> values(count);
    for (hsize_t i = 0; i < count; ++i) {
      values[i] = begin + static_cast<float>(i);
    }
    WriteHdf5Dataset(file_, path, dims, H5T_NATIVE_FLOAT, values.data());
  }

 private:
  static void Put(hid_t object, const std::string& name, hid_t type, hsize_t count,
                  const void* bytes) {
    const hid_t space = count == 1 ? H5Screate(H5S_SCALAR) : H5Screate_simple(1, &count, nullptr);
    const hid_t opened = H5Acreate2(object, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT);
    ASSERT_GE(H5Awrite(opened, type, bytes), 0);
    H5Aclose(opened);
    H5Sclose(space);
  }

  const hid_t file_;
};

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_HDF5_MESH_FILE_H_
