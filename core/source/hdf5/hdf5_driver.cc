#include "core/source/hdf5/hdf5_driver.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <iterator>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/io/file.h"
#include "core/io/mounted_file.h"

namespace isoscope::source {
namespace {

std::vector<io::FileRange>* g_raw_reads = nullptr;  // null: reads are reads

// The library knows the base.
struct DriverFile : H5FD_t {
  explicit DriverFile(std::shared_ptr<const io::RandomAccessFile> opened)
      : H5FD_t{}, file(std::move(opened)) {}

  std::shared_ptr<const io::RandomAccessFile> file;
  haddr_t end = 0;  // of the addresses in use, as the library sets it
};

DriverFile* DriverFileOf(H5FD_t* file) { return static_cast<DriverFile*>(file); }
const DriverFile* DriverFileOf(const H5FD_t* file) { return static_cast<const DriverFile*>(file); }

bool IsWriting(unsigned flags) {
  return (flags & (H5F_ACC_RDWR | H5F_ACC_CREAT | H5F_ACC_TRUNC)) != 0;
}

// Close has what these return.
H5FD_t* OpenMounted(const char* name, unsigned flags, hid_t /*access*/, haddr_t /*max_address*/) {
  std::optional<io::MountedFile> mounted = io::FindMounted(name);
  if (!mounted.has_value() || IsWriting(flags)) {
    return nullptr;
  }
  return std::make_unique<DriverFile>(std::move(mounted->file)).release();
}

H5FD_t* OpenAny(const char* name, unsigned flags, hid_t /*access*/, haddr_t /*max_address*/) {
  if (IsWriting(flags)) {
    return nullptr;
  }
  auto opened = io::OpenRandomAccessFile(name);
  return opened.ok() ? std::make_unique<DriverFile>(*std::move(opened)).release() : nullptr;
}

herr_t Close(H5FD_t* file) {
  delete DriverFileOf(file);
  return 0;
}

int Compare(const H5FD_t* a, const H5FD_t* b) {
  return std::clamp(DriverFileOf(a)->file->path().compare(DriverFileOf(b)->file->path()), -1, 1);
}

herr_t Query(const H5FD_t* /*file*/, unsigned long* flags) {
  *flags = H5FD_FEAT_DATA_SIEVE | H5FD_FEAT_ACCUMULATE_METADATA_READ;
  return 0;
}

haddr_t EndOfAddresses(const H5FD_t* file, H5FD_mem_t /*type*/) { return DriverFileOf(file)->end; }

herr_t SetEndOfAddresses(H5FD_t* file, H5FD_mem_t /*type*/, haddr_t end) {
  DriverFileOf(file)->end = end;
  return 0;
}

haddr_t EndOfFile(const H5FD_t* file, H5FD_mem_t /*type*/) {
  return static_cast<haddr_t>(DriverFileOf(file)->file->size_bytes());
}

herr_t Read(H5FD_t* file, H5FD_mem_t type, hid_t /*transfer*/, haddr_t address, std::size_t size,
            void* out) {
  if (g_raw_reads != nullptr && type == H5FD_MEM_DRAW) {
    g_raw_reads->push_back({.offset = static_cast<std::int64_t>(address), .size = size});
    return 0;
  }
  const io::RandomAccessFile& from = *DriverFileOf(file)->file;
  const auto end = static_cast<haddr_t>(from.size_bytes());
  // Behind the end of a file are zeros, as for the library's own drivers.
  const std::size_t take =
      address >= end ? 0 : static_cast<std::size_t>(std::min<haddr_t>(size, end - address));
  std::memset(static_cast<char*>(out) + take, 0, size - take);
  const absl::Status status =
      take == 0 ? absl::OkStatus()
                : from.ReadAt(static_cast<std::int64_t>(address), take, static_cast<char*>(out));
  if (!status.ok()) {
    H5Epush2(H5E_DEFAULT, __FILE__, "Read", __LINE__, H5E_ERR_CLS, H5E_IO, H5E_READERROR, "%s",
             std::string(status.message()).c_str());
    return -1;
  }
  return 0;
}

herr_t RefuseWrite(H5FD_t* /*file*/, H5FD_mem_t /*type*/, hid_t /*transfer*/, haddr_t /*address*/,
                   std::size_t /*size*/, const void* /*bytes*/) {
  return -1;
}

hid_t MakeAccess(const char* name, decltype(H5FD_class_t::open) open) {
  H5FD_class_t functions{};
  functions.name = name;
  functions.maxaddr = static_cast<haddr_t>(std::numeric_limits<std::int64_t>::max());
  functions.fc_degree = H5F_CLOSE_WEAK;
  functions.open = open;
  functions.close = Close;
  functions.cmp = Compare;
  functions.query = Query;
  functions.get_eoa = EndOfAddresses;
  functions.set_eoa = SetEndOfAddresses;
  functions.get_eof = EndOfFile;
  functions.read = Read;
  functions.write = RefuseWrite;
  // All kinds of bytes lie in one range of addresses.
  std::fill(std::begin(functions.fl_map), std::end(functions.fl_map), H5FD_MEM_SUPER);
  const hid_t access = H5Pcreate(H5P_FILE_ACCESS);
  H5Pset_driver(access, H5FDregister(&functions), nullptr);
  return access;
}

}  // namespace

hid_t Hdf5DriverAccess(Hdf5DriverFiles files) {
  if (files == Hdf5DriverFiles::kMounted) {
    static const hid_t mounted = MakeAccess("isoscope_mounted", OpenMounted);
    return mounted;
  }
  static const hid_t all = MakeAccess("isoscope", OpenAny);
  return all;
}

std::vector<io::FileRange> NoteRawReads(absl::FunctionRef<void()> read) {
  std::vector<io::FileRange> reads;
  g_raw_reads = &reads;
  read();
  g_raw_reads = nullptr;
  return reads;
}

}  // namespace isoscope::source
