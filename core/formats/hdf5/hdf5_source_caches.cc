// Without caches that hold a chunk the library decodes it for every read of some of its rows: 2048
// times for boxes of 32 x 32 rows of a chunk of 256^3.
//
//   sources of a plane   4 (2 x 2 files)
//   chunk                8 MiB, one in each file
//   cache of a source    8 MiB
//   full caches          4 at most (32 MiB): the next four files, which are below, come after the
//                        dataset was closed and opened again
//
// One size is for all sources, and only some are looked at. So the size is a bound, whatever the others
// have: those with larger chunks are decoded for every read.

#include "core/formats/hdf5/hdf5_source_caches.h"

#include <algorithm>
#include <map>
#include <string>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

#include "core/base/check.h"
#include "core/formats/hdf5/hdf5_dataset.h"
#include "core/io/file.h"
#include "core/source/hdf5/hdf5_far_file.h"
#include "core/source/hdf5/hdf5_file_lookup.h"
#include "core/source/hdf5/hdf5_handle.h"

namespace isoscope::source {
namespace {

// The library itself looks at all of them for each read.
constexpr std::size_t kMaxMappings = 4096;
// Sources that are opened to see their chunks.
constexpr std::size_t kMaxLookedAt = 8;

struct SourceName {
  std::string file;  // as the virtual dataset has it
  std::string dataset;

  friend bool operator<(const SourceName& a, const SourceName& b) {
    return std::pair(a.file, a.dataset) < std::pair(b.file, b.dataset);
  }
};

SourceName NameOfSource(hid_t properties, std::size_t mapping) {
  return {.file = Hdf5TextFrom([&](char* out, std::size_t size) {
            return H5Pget_virtual_filename(properties, mapping, out, size);
          }),
          .dataset = Hdf5TextFrom([&](char* out, std::size_t size) {
            return H5Pget_virtual_dsetname(properties, mapping, out, size);
          })};
}

// Elements by axis of the virtual dataset; `end` is behind the last one.
struct Hdf5Box {
  std::vector<hsize_t> begin{};
  std::vector<hsize_t> end{};
};

// The box around what a source has. False: an axis has no end.
bool BoxOfMapping(hid_t properties, std::size_t mapping, std::size_t rank, Hdf5Box* box) {
  const Hdf5Handle space(H5Pget_virtual_vspace(properties, mapping), H5Sclose);
  box->begin.resize(rank);
  box->end.resize(rank);
  if (!space.is_valid() || H5Sget_simple_extent_ndims(space.get()) != static_cast<int>(rank) ||
      H5Sget_select_bounds(space.get(), box->begin.data(), box->end.data()) < 0) {
    return false;
  }
  for (hsize_t& end : box->end) {
    ++end;
  }
  return true;
}

// Cuts the box at `count` elements from `start` on, and counts from there. False: nothing is left.
bool ClampTo(const std::vector<hsize_t>& start, const std::vector<hsize_t>& count, Hdf5Box* box) {
  for (std::size_t axis = 0; axis < start.size(); ++axis) {
    const hsize_t end = start[axis] + count[axis];
    box->begin[axis] = std::clamp(box->begin[axis], start[axis], end) - start[axis];
    box->end[axis] = std::clamp(box->end[axis], start[axis], end) - start[axis];
    if (box->begin[axis] >= box->end[axis]) {
      return false;
    }
  }
  return true;
}

struct OpenedSource {
  Hdf5Handle file;
  Hdf5Handle dataset;  // invalid: it can't be opened, which whoever reads it hears
};
OpenedSource OpenSource(hid_t virtual_dataset, const SourceName& name) {
  OpenedSource opened;
  if (name.file == ".") {
    opened.file = Hdf5Handle(H5Iget_file_id(virtual_dataset), H5Fclose);
  } else {
    const std::vector<std::string> paths =
        Hdf5PathsOf(Hdf5OtherFile::kOfVirtualDataset, name.file, Hdf5FileOf(virtual_dataset));
    const auto path = std::find_if(paths.begin(), paths.end(), io::PathExists);
    if (path != paths.end() &&
        io::CheckIsRegularFile(*path).ok()) {  // HDF5 would wait for a writer
      opened.file = OpenHdf5ToRead(*path);
    }
  }
  if (opened.file.is_valid()) {
    opened.dataset =
        Hdf5Handle(H5Dopen2(opened.file.get(), name.dataset.c_str(), H5P_DEFAULT), H5Dclose);
  }
  return opened;
}

// The chunks of a source; zeros if it has none. Not set: it is a virtual dataset itself.
std::optional<Hdf5SourceCaches::Chunks> ChunksOf(hid_t virtual_dataset, const SourceName& name,
                                                 std::size_t rank_of_volume,
                                                 const AxisOrder& axes) {
  Hdf5SourceCaches::Chunks chunks;
  const OpenedSource source = OpenSource(virtual_dataset, name);
  if (!source.dataset.is_valid()) {
    return chunks;
  }
  const Hdf5Handle properties(H5Dget_create_plist(source.dataset.get()), H5Pclose);
  const H5D_layout_t layout = H5Pget_layout(properties.get());
  if (layout == H5D_VIRTUAL) {
    return std::nullopt;
  }
  const Hdf5Handle type(H5Dget_type(source.dataset.get()), H5Tclose);
  const std::vector<std::int64_t> dims = Hdf5DimsOf(source.dataset.get());
  std::vector<hsize_t> chunk(dims.size());
  if (layout != H5D_CHUNKED || dims.empty() ||
      H5Pget_chunk(properties.get(), static_cast<int>(chunk.size()), chunk.data()) !=
          static_cast<int>(chunk.size())) {
    return chunks;
  }
  chunks.chunk_bytes = static_cast<double>(H5Tget_size(type.get()));
  double count = 1;
  for (std::size_t axis = 0; axis < dims.size(); ++axis) {
    chunks.chunk_bytes *= static_cast<double>(chunk[axis]);
    // With the axes of the volume, a plane needs a layer of chunks; else all of them.
    if (dims.size() != rank_of_volume || axis == axes.y || axis == axes.x) {
      const hsize_t along_axis = (static_cast<hsize_t>(dims[axis]) + chunk[axis] - 1) / chunk[axis];
      count *= static_cast<double>(along_axis);
    }
  }
  chunks.plane_bytes = count * chunks.chunk_bytes;
  return chunks;
}

// The most sources that one plane needs.
std::size_t MostSourcesOfAPlane(const std::vector<Hdf5SourceCaches::Mapping>& mappings,
                                std::size_t source_count) {
  std::size_t most = 0;
  std::vector<std::size_t> seen_by(source_count, 0);  // number of the plane that needed it last
  for (std::size_t i = 0; i < mappings.size(); ++i) {
    const std::int64_t z = mappings[i].begin_z;  // where sources begin there are the most
    std::size_t count = 0;
    for (const Hdf5SourceCaches::Mapping& mapping : mappings) {
      if (mapping.begin_z <= z && z < mapping.end_z && seen_by[mapping.source] != i + 1) {
        seen_by[mapping.source] = i + 1;
        ++count;
      }
    }
    most = std::max(most, count);
  }
  return most;
}

std::size_t SourceCountOf(const std::vector<Hdf5SourceCaches::Mapping>& mappings) {
  std::size_t count = 0;
  for (const Hdf5SourceCaches::Mapping& mapping : mappings) {
    count = std::max(count, mapping.source + 1);
  }
  return count;
}

}  // namespace

Hdf5SourceCaches::Hdf5SourceCaches(std::vector<Mapping> mappings, std::size_t source_count,
                                   std::int64_t cache_bytes, std::size_t max_full)
    : mappings_(std::move(mappings)),
      cache_bytes_(cache_bytes),
      max_full_(max_full),
      is_full_(source_count, false) {}

std::optional<Hdf5SourceCaches> Hdf5SourceCaches::Plan(std::vector<Mapping> mappings,
                                                       const Chunks& chunks,
                                                       std::int64_t max_bytes) {
  const std::size_t source_count = SourceCountOf(mappings);
  const std::size_t of_plane = MostSourcesOfAPlane(mappings, source_count);
  if (of_plane == 0 || chunks.chunk_bytes <= 0) {
    return std::nullopt;
  }
  const double least_bytes = static_cast<double>(of_plane) * chunks.chunk_bytes;
  if (least_bytes > static_cast<double>(std::max(max_bytes, kMaxHdf5SourceCacheBytes))) {
    return std::nullopt;
  }
  const std::int64_t all_bytes = std::max(max_bytes, static_cast<std::int64_t>(least_bytes));
  const auto cache_bytes = static_cast<std::int64_t>(
      std::min(chunks.plane_bytes, static_cast<double>(all_bytes) / static_cast<double>(of_plane)));
  const auto max_full = static_cast<std::size_t>(all_bytes / cache_bytes);
  ISOSCOPE_CHECK(max_full >= of_plane);
  return Hdf5SourceCaches(std::move(mappings), source_count, cache_bytes, max_full);
}

std::optional<Hdf5SourceCaches> Hdf5SourceCaches::Find(hid_t dataset,
                                                       const std::vector<hsize_t>& start,
                                                       const std::vector<hsize_t>& count,
                                                       const AxisOrder& axes,
                                                       std::int64_t max_bytes) {
  const Hdf5Handle properties(H5Dget_create_plist(dataset), H5Pclose);
  std::size_t mapping_count = 0;
  if (!properties.is_valid() || H5Pget_layout(properties.get()) != H5D_VIRTUAL ||
      H5Pget_virtual_count(properties.get(), &mapping_count) < 0 || mapping_count > kMaxMappings) {
    return std::nullopt;
  }
  std::vector<Mapping> mappings;
  std::map<SourceName, std::size_t> sources;
  Chunks chunks;
  for (std::size_t i = 0; i < mapping_count; ++i) {
    const SourceName name = NameOfSource(properties.get(), i);
    Hdf5Box box;
    if (!BoxOfMapping(properties.get(), i, start.size(), &box) ||
        absl::StrContains(absl::StrCat(name.file, name.dataset), "%")) {
      return std::nullopt;
    }
    if (!ClampTo(start, count, &box)) {
      continue;
    }
    const auto [source, is_new] = sources.emplace(name, sources.size());
    if (is_new && sources.size() <= kMaxLookedAt) {
      const std::optional<Chunks> found = ChunksOf(dataset, name, start.size(), axes);
      if (!found.has_value()) {
        return std::nullopt;
      }
      chunks.chunk_bytes = std::max(chunks.chunk_bytes, found->chunk_bytes);
      chunks.plane_bytes = std::max(chunks.plane_bytes, found->plane_bytes);
    }
    mappings.push_back({.source = source->second,
                        .begin_z = static_cast<std::int64_t>(box.begin[axes.z]),
                        .end_z = static_cast<std::int64_t>(box.end[axes.z]),
                        .begin_y = static_cast<std::int64_t>(box.begin[axes.y]),
                        .end_y = static_cast<std::int64_t>(box.end[axes.y])});
  }
  return Plan(std::move(mappings), chunks, max_bytes);
}

std::int64_t Hdf5SourceCaches::max_bytes() const {
  return cache_bytes_ * static_cast<std::int64_t>(std::min(max_full_, is_full_.size()));
}

Hdf5SourceCaches::Step Hdf5SourceCaches::Next(std::int64_t begin_z, std::int64_t end_z,
                                              std::int64_t begin_y, std::int64_t end_y) {
  Step step{.end_z = begin_z};
  std::vector<std::size_t> needed;
  while (step.end_z < end_z) {
    needed.clear();
    const auto find_needed = [&] {
      for (const Mapping& mapping : mappings_) {
        if (mapping.begin_z <= step.end_z && step.end_z < mapping.end_z &&
            mapping.begin_y < end_y && begin_y < mapping.end_y && !is_full_[mapping.source]) {
          is_full_[mapping.source] = true;
          needed.push_back(mapping.source);
        }
      }
    };
    find_needed();
    if (full_count_ + needed.size() > max_full_) {
      if (step.end_z > begin_z) {  // the planes before go first
        for (const std::size_t source : needed) {
          is_full_[source] = false;
        }
        return step;
      }
      step.must_reopen = true;
      std::fill(is_full_.begin(), is_full_.end(), false);
      full_count_ = 0;
      needed.clear();
      find_needed();
    }
    full_count_ += needed.size();
    ++step.end_z;
  }
  return step;
}

}  // namespace isoscope::source
