// The library takes drivers for files ("virtual file layer"); ours reads a mounted file by position.
//
// - Where a chunk is stored: H5Dget_chunk_info_by_coord walks through all chunks. H5Dread_chunk finds
//   one in the index, and then reads it: while g_probe is set, the driver notes where, and reads nothing.
// - netCDF calls H5Fopen by the name of a file, without a driver. H5Fopen below takes the place of the
//   library's for the whole process (symbols of the program go first), and calls it.

#include "core/source/hdf5/hdf5_far_file.h"

#include <dlfcn.h>
#include <unistd.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <iterator>
#include <map>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include <sys/mman.h>

#include "core/io/file.h"
#include "core/source/hdf5/hdf5_file_lookup.h"

namespace isoscope::source {
namespace {

constexpr hsize_t kMaxProbeBytes = hsize_t{1} << 28;
constexpr std::size_t kMaxFarObjects = 100'000;

// What a probe has found; null: reads are reads. For the only thread that calls the library.
std::optional<io::FileRange>* g_probe = nullptr;

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

herr_t ReadFarHdf5(H5FD_t* file, H5FD_mem_t type, hid_t /*transfer*/, haddr_t address,
                   std::size_t size, void* out) {
  if (g_probe != nullptr && type == H5FD_MEM_DRAW) {
    *g_probe = io::FileRange{.offset = static_cast<std::int64_t>(address), .size = size};
    return 0;
  }
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

std::map<std::string, std::string>& StandIns() {
  static auto* const paths = new std::map<std::string, std::string>;  // by name
  return *paths;
}

// True if the elements of a dataset lie in its file, whatever it says.
bool IsInItsFile(hid_t dataset) {
  const Hdf5Handle properties(H5Dget_create_plist(dataset), H5Pclose);
  return properties.is_valid() && H5Pget_layout(properties.get()) != H5D_VIRTUAL &&
         H5Pget_external_count(properties.get()) == 0;
}

struct FarVisit {
  std::size_t objects = 0;
  std::string wrong = {};
};

herr_t VisitFarObject(hid_t file, const char* name, const H5O_info_t* info, void* data) {
  FarVisit& visit = *static_cast<FarVisit*>(data);
  if (info->type == H5O_TYPE_DATASET) {
    const Hdf5Handle dataset(H5Dopen2(file, name, H5P_DEFAULT), H5Dclose);
    if (!dataset.is_valid() || !IsInItsFile(dataset.get())) {
      visit.wrong = name;
      return 1;
    }
  }
  return ++visit.objects > kMaxFarObjects ? -1 : 0;
}

}  // namespace

herr_t ReadWholeHdf5(hid_t dataset, hid_t type, void* out) {
  if (io::IsMounted(Hdf5FileOf(dataset)) && !IsInItsFile(dataset)) {
    return -1;
  }
  return H5Dread(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, out);
}

absl::Status CheckFarHdf5Objects(hid_t file, const std::string& path) {
  if (!io::IsMounted(path)) {
    return absl::OkStatus();
  }
  FarVisit visit;
  const herr_t status =
      H5Ovisit2(file, H5_INDEX_NAME, H5_ITER_NATIVE, VisitFarObject, &visit, H5O_INFO_BASIC);
  if (status > 0) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": the samples of \"", visit.wrong,
                                                   "\" are in other files, which can't be read at "
                                                   "an address; bring them all to a folder, each "
                                                   "with: isoscope copy ADDRESS DIR"));
  }
  return status == 0 ? absl::OkStatus()
                     : absl::DataLossError(absl::StrCat(
                           path, ": its objects can't be listed, or are more than ", kMaxFarObjects,
                           ": ", LastHdf5Error(), "; bring it with: isoscope copy ", path));
}

std::optional<io::FileRange> FindFarHdf5Chunk(hid_t dataset, const hsize_t* first_element) {
  hsize_t size = 0;
  if (H5Dget_chunk_storage_size(dataset, first_element, &size) < 0 || size == 0 ||
      size > kMaxProbeBytes) {
    return std::nullopt;
  }
  std::optional<io::FileRange> found;
  const std::unique_ptr<char[]> unused(new char[size]);  // no page of it is touched
  std::uint32_t filters = 0;
  g_probe = &found;
  const herr_t status = H5Dread_chunk(dataset, H5P_DEFAULT, first_element, &filters, unused.get());
  g_probe = nullptr;
  return status < 0 || !found.has_value() || found->size != size ? std::nullopt : found;
}

absl::StatusOr<std::string> StandInForFarHdf5(const std::string& path) {
  constexpr char kSignature[] = "\x89HDF\r\n\x1a\n";
  for (const auto& [name, known] : StandIns()) {
    if (known == path) {
      return name;
    }
  }
  const int file = memfd_create("isoscope_far", MFD_CLOEXEC);  // stays open
  if (file < 0 || write(file, kSignature, sizeof(kSignature) - 1) != sizeof(kSignature) - 1 ||
      ftruncate(file, 512) != 0) {
    return absl::ResourceExhaustedError(absl::StrCat(path, ": no memory for a file"));
  }
  const std::string name = absl::StrCat("/proc/self/fd/", file);
  StandIns()[name] = path;
  return name;
}

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

// In place of the library's own, which it calls. Other libraries give no driver, and close a file
// otherwise than we do: a file that is open twice needs one way.
extern "C" __attribute__((visibility("default"))) hid_t H5Fopen(const char* name, unsigned flags,
                                                                hid_t access) {
  using isoscope::source::Hdf5Handle;
  using Function = hid_t (*)(const char*, unsigned, hid_t);
  static const auto next = reinterpret_cast<Function>(dlsym(RTLD_NEXT, "H5Fopen"));
  if (next == nullptr) {
    return H5I_INVALID_HID;
  }
  const auto found = isoscope::source::StandIns().find(name);
  if (found == isoscope::source::StandIns().end()) {
    return next(name, flags, access);
  }
  const Hdf5Handle copy(access == H5P_DEFAULT ? H5Pcreate(H5P_FILE_ACCESS) : H5Pcopy(access),
                        H5Pclose);
  H5Pset_driver(copy.get(), isoscope::source::FarDriver(), nullptr);
  H5Pset_fclose_degree(copy.get(), H5F_CLOSE_WEAK);
  return next(found->second.c_str(), flags, copy.get());
}
