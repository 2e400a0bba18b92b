#include "core/source/hdf5/hdf5_read_ahead.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "core/source/hdf5/hdf5_far_file.h"
#include "core/source/hdf5/hdf5_file_lookup.h"
#include "core/source/hdf5/hdf5_handle.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kMaxExpectedChunks = 32'768;

}  // namespace

Hdf5ReadAhead::Hdf5ReadAhead(hid_t dataset, std::vector<hsize_t> start, std::vector<hsize_t> count,
                             std::size_t plane_axis, std::int64_t cache_bytes)
    : dataset_(dataset),
      start_(std::move(start)),
      count_(std::move(count)),
      plane_axis_(plane_axis) {
  std::optional<io::MountedFile> file = io::FindMounted(Hdf5FileOf(dataset));
  const Hdf5Handle properties(H5Dget_create_plist(dataset), H5Pclose);
  const Hdf5Handle type(H5Dget_type(dataset), H5Tclose);
  std::vector<hsize_t> chunk(start_.size());
  if (!file.has_value() || file->expect_reads == nullptr || !properties.is_valid() ||
      H5Pget_layout(properties.get()) != H5D_CHUNKED ||
      H5Pget_chunk(properties.get(), static_cast<int>(chunk.size()), chunk.data()) !=
          static_cast<int>(chunk.size()) ||
      std::find(chunk.begin(), chunk.end(), 0) != chunk.end()) {
    return;
  }
  auto layer_bytes = static_cast<double>(H5Tget_size(type.get()));
  for (std::size_t axis = 0; axis < chunk.size(); ++axis) {
    layer_bytes *= static_cast<double>(chunk[axis]);
    if (axis != plane_axis_) {
      const hsize_t first = start_[axis] / chunk[axis];
      const hsize_t last = (start_[axis] + count_[axis] - 1) / chunk[axis];
      layer_bytes *= static_cast<double>(last - first + 1);
    }
  }
  keeps_layer_ = layer_bytes <= static_cast<double>(cache_bytes);
  chunk_ = std::move(chunk);
  expect_ = std::move(file->expect_reads);
}

void Hdf5ReadAhead::BeforePlanes(std::int64_t begin, std::int64_t end) {
  if (chunk_.empty() || begin >= end) {
    return;
  }
  const hsize_t chunk = chunk_[plane_axis_];
  const hsize_t first = start_[plane_axis_];
  const hsize_t begin_layer = (first + static_cast<hsize_t>(begin)) / chunk;
  const hsize_t end_layer = (first + static_cast<hsize_t>(end) - 1) / chunk + 1;
  if (!keeps_layer_) {
    ExpectLayers(begin_layer, end_layer);
    return;
  }
  if (begin_layer < expected_begin_ || begin_layer > expected_end_) {
    expected_end_ = begin_layer;
  }
  expected_begin_ = begin_layer;
  // Whoever leaves planes out, as for a few values of each part, may not want the next layer.
  const bool goes_on = begin == last_end_ || begin + 1 == last_end_;
  last_end_ = end;
  const hsize_t last_layer = (first + count_[plane_axis_] - 1) / chunk + 1;
  const hsize_t ahead = goes_on ? std::min(end_layer + 1, last_layer) : end_layer;
  for (const hsize_t to : {end_layer, ahead}) {
    if (to > expected_end_) {
      ExpectLayers(std::max(begin_layer, expected_end_), to);
      expected_end_ = to;
    }
  }
}

void Hdf5ReadAhead::ExpectLayers(hsize_t begin, hsize_t end) {
  // The library reads chunks in this order: the last axis is the fastest.
  const std::size_t rank = chunk_.size();
  std::vector<hsize_t> least(rank);
  std::vector<hsize_t> most(rank);
  for (std::size_t axis = 0; axis < rank; ++axis) {
    least[axis] = axis == plane_axis_ ? begin : start_[axis] / chunk_[axis];
    most[axis] = axis == plane_axis_ ? end - 1 : (start_[axis] + count_[axis] - 1) / chunk_[axis];
  }
  std::vector<io::FileRange> ranges;
  std::vector<hsize_t> index = least;
  std::vector<hsize_t> element(rank);
  for (bool goes_on = true; goes_on && ranges.size() < kMaxExpectedChunks;) {
    for (std::size_t axis = 0; axis < rank; ++axis) {
      element[axis] = index[axis] * chunk_[axis];
    }
    if (const auto range = FindFarHdf5Chunk(dataset_, element.data()); range.has_value()) {
      ranges.push_back(*range);
    }
    std::size_t axis = rank;
    while (axis > 0 && index[axis - 1] == most[axis - 1]) {
      index[axis - 1] = least[axis - 1];
      --axis;
    }
    goes_on = axis > 0;
    if (goes_on) {
      ++index[axis - 1];
    }
  }
  expect_(ranges);
}

}  // namespace isoscope::source
