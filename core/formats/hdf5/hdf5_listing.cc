// A file is a graph: groups have links, by name, to groups and datasets. A link is hard, or it
// names a path (soft), or a path in another file (external). Links may lead in circles, so that
// each object is visited once, by its address.

#include "core/formats/hdf5/hdf5_listing.h"

#include <algorithm>
#include <cstddef>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

#include "core/formats/hdf5/hdf5_attributes.h"
#include "core/formats/hdf5/hdf5_dataset.h"
#include "core/formats/hdf5/hdf5_mesh.h"
#include "core/source/grid/axis_order.h"
#include "core/source/hdf5/hdf5_external_links.h"
#include "core/source/hdf5/hdf5_filters.h"
#include "core/source/hdf5/hdf5_handle.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kMaxEntries = 10'000;
constexpr int kMaxDepth = 64;

class Hdf5Walk {
 public:
  explicit Hdf5Walk(hid_t start) {
    H5O_info_t info{};
    if (H5Oget_info2(start, &info, H5O_INFO_BASIC) >= 0) {
      visited_.insert({info.fileno, info.addr});
    }
  }
  // `path` ends with '/'.
  void Visit(hid_t group, const std::string& path, int depth) {
    if (depth > kMaxDepth) {
      return;
    }
    for (const std::string& name : Hdf5NamesIn(group)) {
      if (entries_.size() >= kMaxEntries) {
        return;
      }
      if (name != "#refs#" && name != "#subsystem#") {  // MATLAB's
        VisitLink(group, name, path + name, depth);
      }
    }
  }
  std::vector<Hdf5Entry> TakeEntries() { return std::move(entries_); }

 private:
  void VisitLink(hid_t group, const std::string& name, const std::string& path, int depth) {
    const Hdf5Handle object(H5Oopen(group, name.c_str(), H5P_DEFAULT), H5Oclose);
    if (!object.is_valid()) {
      AddMissing(group, name, path);
      return;
    }
    H5O_info_t info{};
    if (H5Oget_info2(object.get(), &info, H5O_INFO_BASIC) < 0 ||
        !visited_.insert({info.fileno, info.addr}).second) {
      return;
    }
    if (info.type == H5O_TYPE_GROUP) {
      Visit(object.get(), path + "/", depth + 1);
    } else if (info.type == H5O_TYPE_DATASET) {
      AddDataset(object.get(), path);
    }
  }

  void AddDataset(hid_t dataset, const std::string& path) {
    if (Hdf5Text(dataset, {"MATLAB_class"}) == "char" || H5Aexists(dataset, "MATLAB_empty") > 0) {
      return;
    }
    if (const absl::Status sources = CheckHdf5Sources(dataset); !sources.ok()) {
      entries_.push_back({.name = path, .missing = std::string(sources.message())});
      return;
    }
    const Hdf5Handle type(H5Dget_type(dataset), H5Tclose);
    entries_.push_back({.name = path,
                        .dims = Hdf5DimsOf(dataset),
                        .type = Hdf5TypeName(type.get()),
                        .filters = DescribeHdf5Filters(dataset),
                        .is_plain = IsPlainHdf5Type(dataset),
                        .is_samples = Hdf5SampleTypeOf(dataset).ok()});
  }

  void AddMissing(hid_t group, const std::string& name, const std::string& path) {
    if (std::string why = WhyLinkIsBroken(group, name); !why.empty()) {
      entries_.push_back({.name = path, .missing = std::move(why)});
    }
  }

  using Address = std::pair<unsigned long, haddr_t>;  // of a file and of an object in it
  std::set<Address> visited_;
  std::vector<Hdf5Entry> entries_;
};

std::string Shape(const Hdf5Entry& entry) {
  if (!entry.missing.empty()) {
    return absl::StrCat(entry.name, " (", entry.missing, ")");
  }
  return absl::StrCat(entry.name, " (", absl::StrJoin(entry.dims, " x "),
                      entry.dims.empty() ? "" : " ", entry.type, entry.filters.empty() ? "" : ", ",
                      entry.filters, ")");
}

}  // namespace

std::vector<Hdf5Entry> ListHdf5Entries(hid_t file) {
  Hdf5Walk walk(file);
  walk.Visit(file, "/", 0);
  return walk.TakeEntries();
}

bool IsHdf5Volume(const Hdf5Entry& entry, std::size_t axes) {
  const bool is_empty = std::find(entry.dims.begin(), entry.dims.end(), 0) != entry.dims.end();
  return entry.is_samples && !is_empty &&
         (axes > 0 ? entry.dims.size() == axes : entry.dims.size() >= 3);
}

std::string DescribeHdf5Entries(const std::vector<Hdf5Entry>& entries) {
  constexpr std::size_t kMaxVolumes = 50;
  constexpr std::size_t kMaxOthers = 6;
  std::vector<const Hdf5Entry*> listed;
  for (const Hdf5Entry& entry : entries) {
    if (IsHdf5Volume(entry)) {
      listed.push_back(&entry);
    }
  }
  const bool has_volumes = !listed.empty();
  for (const Hdf5Entry& entry : entries) {
    if (has_volumes ? !entry.missing.empty() : true) {
      listed.push_back(&entry);
    }
  }
  const std::size_t most = has_volumes ? kMaxVolumes : kMaxOthers;
  std::string text = has_volumes ? "" : "no dataset of numbers with three axes or more";
  for (std::size_t i = 0; i < listed.size() && i < most; ++i) {
    absl::StrAppend(&text, i > 0 ? ", " : has_volumes ? "" : ", but ", Shape(*listed[i]));
  }
  if (listed.size() > most) {
    absl::StrAppend(&text, ", and ", listed.size() - most, " more");
  }
  return text;
}

}  // namespace isoscope::source
