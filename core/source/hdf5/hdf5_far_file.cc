// Our driver (hdf5_driver.h) reads a mounted file. netCDF calls H5Fopen by the name of a file, without a
// driver. H5Fopen below takes the place of the library's for the whole process (symbols of the program
// go first), and calls it.

#include "core/source/hdf5/hdf5_far_file.h"

#include <dlfcn.h>
#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <vector>

#include "absl/strings/str_cat.h"
#include <sys/mman.h>

#include "core/source/hdf5/hdf5_driver.h"
#include "core/source/hdf5/hdf5_file_lookup.h"

namespace isoscope::source {
namespace {

constexpr hsize_t kMaxProbeBytes = hsize_t{1} << 28;
constexpr std::size_t kMaxFarObjects = 100'000;

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
  const std::unique_ptr<char[]> unused(new char[size]);  // no page of it is touched
  std::uint32_t filters = 0;
  herr_t status = -1;
  const std::vector<io::FileRange> reads = NoteRawReads(
      [&] { status = H5Dread_chunk(dataset, H5P_DEFAULT, first_element, &filters, unused.get()); });
  if (status < 0 || reads.size() != 1 || reads.front().size != size) {
    return std::nullopt;
  }
  return reads.front();
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
  return Hdf5Handle(
      H5Fopen(path.c_str(), H5F_ACC_RDONLY, Hdf5DriverAccess(Hdf5DriverFiles::kMounted)), H5Fclose);
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
  const hid_t ours =
      isoscope::source::Hdf5DriverAccess(isoscope::source::Hdf5DriverFiles::kMounted);
  const Hdf5Handle list(H5Pcopy(access == H5P_DEFAULT ? ours : access), H5Pclose);
  H5Pset_driver(list.get(), H5Pget_driver(ours), nullptr);
  H5Pset_fclose_degree(list.get(), H5F_CLOSE_WEAK);
  return next(found->second.c_str(), flags, list.get());
}
