#include "core/source/hdf5/hdf5_far_file.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <optional>
#include <utility>

#include "core/io/file.h"
#include "core/io/mounted_file.h"
#include "hdf5.h"

namespace isoscope::source {
namespace {

// The library knows the base.
struct FarHdf5 : H5FD_t {
  FarHdf5() : H5FD_t{} {}

  std::shared_ptr<const io::RandomAccessFile> file;
  haddr_t end = 0;  // of the addresses in use, as the library sets it
};

FarHdf5* FarOf(H5FD_t* file) { return static_cast<FarHdf5*>(file); }
const FarHdf5* FarOf(const H5FD_t* file) { return static_cast<const FarHdf5*>(file); }

H5FD_t* OpenFar(const char* name, unsigned flags, hid_t /*access*/, haddr_t /*max_address*/) {
  std::optional<io::MountedFile> mounted = io::FindMounted(name);
  if (!mounted.has_value() || (flags & (H5F_ACC_RDWR | H5F_ACC_CREAT | H5F_ACC_TRUNC)) != 0) {
    return nullptr;
  }
  auto far = std::make_unique<FarHdf5>();
  far->file = std::move(mounted->file);
  return far.release();  // CloseFar has it
}

herr_t CloseFar(H5FD_t* file) {
  delete FarOf(file);
  return 0;
}

int CompareFar(const H5FD_t* a, const H5FD_t* b) {
  return std::clamp(FarOf(a)->file->path().compare(FarOf(b)->file->path()), -1, 1);
}

herr_t QueryFar(const H5FD_t* /*file*/, unsigned long* flags) {
  *flags = H5FD_FEAT_DATA_SIEVE | H5FD_FEAT_ACCUMULATE_METADATA_READ;
  return 0;
}

haddr_t EndOfAddresses(const H5FD_t* file, H5FD_mem_t /*type*/) { return FarOf(file)->end; }

herr_t SetEndOfAddresses(H5FD_t* file, H5FD_mem_t /*type*/, haddr_t end) {
  FarOf(file)->end = end;
  return 0;
}

haddr_t EndOfFile(const H5FD_t* file, H5FD_mem_t /*type*/) {
  return static_cast<haddr_t>(FarOf(file)->file->size_bytes());
}

herr_t ReadFarHdf5(H5FD_t* file, H5FD_mem_t /*type*/, hid_t /*transfer*/, haddr_t address,
                   std::size_t size, void* out) {
  const io::RandomAccessFile& from = *FarOf(file)->file;
  const auto end = static_cast<haddr_t>(from.size_bytes());
  // Behind the end of a file are zeros, as for the library's own drivers.
  const std::size_t take =
      address >= end ? 0 : static_cast<std::size_t>(std::min<haddr_t>(size, end - address));
  std::memset(static_cast<char*>(out) + take, 0, size - take);
  const absl::Status status =
      take == 0 ? absl::OkStatus()
                : from.ReadAt(static_cast<std::int64_t>(address), take, static_cast<char*>(out));
  if (!status.ok()) {
    H5Epush2(H5E_DEFAULT, __FILE__, "ReadFarHdf5", __LINE__, H5E_ERR_CLS, H5E_IO, H5E_READERROR,
             "%s", std::string(status.message()).c_str());
    return -1;
  }
  return 0;
}

herr_t WriteFarHdf5(H5FD_t* /*file*/, H5FD_mem_t /*type*/, hid_t /*transfer*/, haddr_t /*address*/,
                    std::size_t /*size*/, const void* /*bytes*/) {
  return -1;
}

hid_t FarDriver() {
  static const hid_t driver = [] {
    H5FD_class_t functions{};
    functions.name = "isoscope_far";
    functions.maxaddr = static_cast<haddr_t>(INT64_MAX);
    functions.fc_degree = H5F_CLOSE_WEAK;
    functions.open = OpenFar;
    functions.close = CloseFar;
    functions.cmp = CompareFar;
    functions.query = QueryFar;
    functions.get_eoa = EndOfAddresses;
    functions.set_eoa = SetEndOfAddresses;
    functions.get_eof = EndOfFile;
    functions.read = ReadFarHdf5;
    functions.write = WriteFarHdf5;
    // All kinds of bytes lie in one range of addresses.
    std::fill(std::begin(functions.fl_map), std::end(functions.fl_map), H5FD_MEM_SUPER);
    return H5FDregister(&functions);
  }();
  return driver;
}

}  // namespace

Hdf5Handle OpenHdf5ToRead(const std::string& path) {
  if (!io::IsMounted(path)) {
    return Hdf5Handle(H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
  }
  // It stays open: each call of the library, as closing it, would clear the error of H5Fopen.
  static const hid_t access = [] {
    const hid_t list = H5Pcreate(H5P_FILE_ACCESS);
    H5Pset_driver(list, FarDriver(), nullptr);
    return list;
  }();
  return Hdf5Handle(H5Fopen(path.c_str(), H5F_ACC_RDONLY, access), H5Fclose);
}

}  // namespace isoscope::source
