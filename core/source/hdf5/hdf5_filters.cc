// Numbers and names are those of the HDF Group's registry,
// https://github.com/HDFGroup/hdf5_plugins/blob/master/docs/RegisteredFilterPlugins.md.

#include "core/source/hdf5/hdf5_filters.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdlib>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"

#include "core/source/hdf5/hdf5_handle.h"
#include "hdf5.h"

namespace isoscope::source {
namespace {

struct KnownFilter {
  unsigned int id;
  const char* name;
  const char* package;  // of Debian 12; "": none
};
constexpr std::array<KnownFilter, 32> kKnownFilters{
    {{1, "gzip", ""},
     {2, "shuffle", ""},
     {3, "Fletcher32", ""},
     {4, "szip", ""},
     {5, "N-bit", ""},
     {6, "scale-offset", ""},
     {305, "LZO", ""},
     {307, "bzip2", "hdf5-filter-plugin"},
     {32000, "LZF", "hdf5-plugin-lzf"},
     {32001, "Blosc", "hdf5-filter-plugin-blosc-serial"},
     {32002, "MAFISC", ""},
     {32003, "Snappy", ""},
     {32004, "LZ4", "hdf5-filter-plugin"},
     {32005, "APAX", ""},
     {32006, "CBF", ""},
     {32007, "JPEG-XR", ""},
     {32008, "bitshuffle", ""},
     {32009, "SPDP", ""},
     {32010, "LPC-Rice", ""},
     {32011, "CCSDS-123", ""},
     {32012, "JPEG-LS", ""},
     {32013, "ZFP", "hdf5-filter-plugin-zfp-serial"},
     {32014, "fpzip", ""},
     {32015, "Zstandard", ""},
     {32016, "B3D", ""},
     {32017, "SZ", ""},
     {32018, "FCIDECOMP", ""},
     {32019, "JPEG", ""},
     {32020, "VBZ", ""},
     {32022, "BitGroom", ""},
     {32024, "SZ3", ""},
     {32026, "Blosc2", ""}}};

const KnownFilter* FindFilter(unsigned int id) {
  const auto* const found =
      std::find_if(kKnownFilters.begin(), kKnownFilters.end(),
                   [id](const KnownFilter& filter) { return filter.id == id; });
  return found == kKnownFilters.end() ? nullptr : found;
}

struct StoredFilter {
  unsigned int id = 0;
  std::string name{};  // "filter 32099" of one that nobody knows
};

std::vector<StoredFilter> FiltersOf(hid_t dataset) {
  const Hdf5Handle properties(H5Dget_create_plist(dataset), H5Pclose);
  const int count = properties.is_valid() ? H5Pget_nfilters(properties.get()) : 0;
  std::vector<StoredFilter> filters;
  for (int i = 0; i < count; ++i) {
    unsigned int flags = 0;
    std::size_t values = 0;
    std::array<char, 128> name{};
    unsigned int config = 0;
    const H5Z_filter_t id = H5Pget_filter2(properties.get(), static_cast<unsigned int>(i), &flags,
                                           &values, nullptr, name.size(), name.data(), &config);
    if (id > 0) {
      const KnownFilter* const known = FindFilter(static_cast<unsigned int>(id));
      filters.push_back({.id = static_cast<unsigned int>(id),
                         .name = known != nullptr ? known->name : absl::StrCat("filter ", id)});
    }
  }
  return filters;
}

}  // namespace

void PrepareHdf5Filters() {
  static bool is_prepared = false;
  if (is_prepared || H5open() < 0) {
    return;
  }
  is_prepared = true;
  unsigned int count = 0;
  while (H5PLsize(&count) >= 0 && count > 0 && H5PLremove(count - 1) >= 0) {
  }
  H5PLappend(H5_DEFAULT_PLUGINDIR);
  // NOLINTNEXTLINE(concurrency-mt-unsafe): no code sets variables
  const char* const added = std::getenv("ISOSCOPE_HDF5_PLUGIN_PATH");
  for (const absl::string_view folder :
       absl::StrSplit(added != nullptr ? added : "", ':', absl::SkipEmpty())) {
    if (folder.front() == '/') {
      H5PLappend(std::string(folder).c_str());
    }
  }
}

absl::Status CheckHdf5Filter(unsigned int id) {
  return H5Zfilter_avail(static_cast<H5Z_filter_t>(id)) > 0 ? absl::OkStatus()
                                                            : MissingHdf5Filter(id);
}

absl::Status MissingHdf5Filter(unsigned int id) {
  const KnownFilter* const known = FindFilter(id);
  const std::string advice =
      known != nullptr && known->package[0] != '\0'
          ? absl::StrCat("install Debian's package ", known->package)
          : "Debian has no package of it: rewrite the file where the filter is installed, with "
            "h5repack -f GZIP=4 IN OUT, or name the folder of its plugin in "
            "ISOSCOPE_HDF5_PLUGIN_PATH";
  return absl::InvalidArgumentError(
      absl::StrFormat("compressed by filter %d%s, which is not installed: %s", id,
                      known != nullptr ? absl::StrCat(" (", known->name, ")") : "", advice));
}

absl::Status CheckHdf5Filters(std::int64_t dataset) {
  for (const StoredFilter& filter : FiltersOf(dataset)) {
    const absl::Status status = CheckHdf5Filter(filter.id);
    if (!status.ok()) {
      return status;
    }
  }
  return absl::OkStatus();
}

std::string DescribeHdf5Filters(std::int64_t dataset) {
  std::vector<std::string> texts;
  for (const StoredFilter& filter : FiltersOf(dataset)) {
    constexpr unsigned int kShuffle = 2;
    constexpr unsigned int kFletcher32 = 3;
    if (filter.id != kShuffle && filter.id != kFletcher32) {
      texts.push_back(filter.name + (CheckHdf5Filter(filter.id).ok() ? "" : " (not installed)"));
    }
  }
  return absl::StrJoin(texts, ", ");
}

}  // namespace isoscope::source
