// Volumes in HDF5 files as the library lays them out: contiguous, or in chunks of any filters, some of
// which were left out of a chunk or were never written.

#ifndef ISOSCOPE_TESTS_SUPPORT_HDF5_VOLUME_FILE_H_
#define ISOSCOPE_TESTS_SUPPORT_HDF5_VOLUME_FILE_H_

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "gtest/gtest.h"

#include "core/source/chunks/chunk_box.h"
#include "hdf5.h"
#include "tests/support/volume_files.h"

namespace isoscope::testing {

struct Hdf5VolumeFile {
  math::Index3 dims{};
  hid_t file_type = H5T_STD_U16LE;
  hid_t memory_type = H5T_STD_U16LE;  // of the samples: little-endian
  source::ChunkIndex chunk{};         // [z][y][x]; empty: contiguous
  bool has_shuffle = false;
  bool has_gzip = false;
  bool has_checksum = false;
  bool has_scale_offset = false;  // a filter that only the library knows
  bool is_latest = false;         // another index than a B-tree
  bool has_plain_edges = false;   // no filters of chunks at the border; is_latest
  hsize_t user_block = 0;
  int skipped_every = 0;      // each such chunk, counted from 0, has no filters
  int missing_every = 0;      // each such chunk is not written; the first one stays
  std::string fill{};         // of memory_type; "": the library's zeros
  bool is_last_only = false;  // nothing but the last chunk is written
};

// Writes `samples` as dataset "v". Returns the samples that the file has: those of missing chunks are
// the fill value.
inline std::string WriteHdf5Volume(const std::string& path, const Hdf5VolumeFile& volume,
                                   std::string samples) {
  const hid_t creation = H5Pcreate(H5P_FILE_CREATE);
  H5Pset_userblock(creation, volume.user_block);
  const hid_t access = H5Pcreate(H5P_FILE_ACCESS);
  if (volume.is_latest) {
    H5Pset_libver_bounds(access, H5F_LIBVER_LATEST, H5F_LIBVER_LATEST);
  }
  const hid_t file = H5Fcreate(path.c_str(), H5F_ACC_TRUNC, creation, access);
  const hsize_t dims[] = {static_cast<hsize_t>(volume.dims.z), static_cast<hsize_t>(volume.dims.y),
                          static_cast<hsize_t>(volume.dims.x)};
  const hid_t space = H5Screate_simple(3, dims, nullptr);
  const hid_t properties = H5Pcreate(H5P_DATASET_CREATE);
  const std::size_t size = H5Tget_size(volume.memory_type);
  const std::string fill = volume.fill.empty() ? std::string(size, '\0') : volume.fill;
  if (!volume.fill.empty()) {
    H5Pset_fill_value(properties, volume.memory_type, volume.fill.data());
  }
  if (!volume.chunk.empty()) {
    const hsize_t chunk[] = {static_cast<hsize_t>(volume.chunk[0]),
                             static_cast<hsize_t>(volume.chunk[1]),
                             static_cast<hsize_t>(volume.chunk[2])};
    H5Pset_chunk(properties, 3, chunk);
    if (volume.has_scale_offset) {
      H5Pset_scaleoffset(properties, H5Z_SO_INT, H5Z_SO_INT_MINBITS_DEFAULT);
    }
    if (volume.has_shuffle) {
      H5Pset_shuffle(properties);
    }
    if (volume.has_gzip) {
      H5Pset_deflate(properties, 4);
    }
    if (volume.has_checksum) {
      H5Pset_fletcher32(properties);
    }
    if (volume.has_plain_edges) {
      H5Pset_chunk_opts(properties, H5D_CHUNK_DONT_FILTER_PARTIAL_CHUNKS);
    }
  }
  const hid_t dataset =
      H5Dcreate2(file, "v", volume.file_type, space, H5P_DEFAULT, properties, H5P_DEFAULT);
  EXPECT_GE(dataset, 0);
  const source::ChunkIndex all{volume.dims.z, volume.dims.y, volume.dims.x};
  const source::ChunkGrid grid(all, volume.chunk.empty() ? all : volume.chunk);
  const source::ChunkBox whole = source::BoxOf(all);
  const source::ChunkBox chunks = grid.ChunksOf(whole);
  const bool is_swapped = H5Tget_order(volume.file_type) == H5T_ORDER_BE;
  const std::int64_t last = grid.counts()[0] * grid.counts()[1] * grid.counts()[2] - 1;
  source::ChunkIndex index = chunks.begin;
  std::int64_t number = 0;
  do {
    const source::ChunkBox elements = grid.ElementsOf(index);
    const source::ChunkBox part = source::IntersectionOf(elements, whole);
    const hsize_t start[] = {static_cast<hsize_t>(part.begin[0]),
                             static_cast<hsize_t>(part.begin[1]),
                             static_cast<hsize_t>(part.begin[2])};
    const hsize_t count[] = {static_cast<hsize_t>(part.end[0] - part.begin[0]),
                             static_cast<hsize_t>(part.end[1] - part.begin[1]),
                             static_cast<hsize_t>(part.end[2] - part.begin[2])};
    const bool is_missing =
        (volume.is_last_only && number != last) ||
        (volume.missing_every > 0 && number > 0 && number % volume.missing_every == 0);
    if (is_missing) {
      source::FillPart(part, fill, whole, samples.data());
    } else if (!volume.chunk.empty() && volume.skipped_every > 0 &&
               number % volume.skipped_every == 0) {
      std::string bytes(size, '\0');
      for (const std::int64_t edge : grid.chunk_dims()) {
        bytes.resize(bytes.size() * static_cast<std::size_t>(edge));
      }
      source::CopyPart(part, size, whole, samples.data(), elements, bytes.data());
      bytes = is_swapped ? Swapped(bytes, size) : bytes;
      const auto filters = static_cast<std::uint32_t>((1 << H5Pget_nfilters(properties)) - 1);
      EXPECT_GE(H5Dwrite_chunk(dataset, H5P_DEFAULT, filters, start, bytes.size(), bytes.data()),
                0);
    } else {
      const hid_t memory = H5Screate_simple(3, dims, nullptr);
      H5Sselect_hyperslab(memory, H5S_SELECT_SET, start, nullptr, count, nullptr);
      H5Sselect_hyperslab(space, H5S_SELECT_SET, start, nullptr, count, nullptr);
      EXPECT_GE(H5Dwrite(dataset, volume.memory_type, memory, space, H5P_DEFAULT, samples.data()),
                0);
      H5Sclose(memory);
    }
    ++number;
  } while (source::NextIndex(chunks, &index));
  H5Dclose(dataset);
  H5Pclose(properties);
  H5Sclose(space);
  H5Fclose(file);
  H5Pclose(access);
  H5Pclose(creation);
  return samples;
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_HDF5_VOLUME_FILE_H_
