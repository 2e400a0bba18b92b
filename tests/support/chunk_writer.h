// Writes arrays in chunks and shards, one element after the other: simple code that readers are
// compared with.

#ifndef ISOSCOPE_TESTS_SUPPORT_CHUNK_WRITER_H_
#define ISOSCOPE_TESTS_SUPPORT_CHUNK_WRITER_H_

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/base/coding.h"
#include "core/base/crc32c.h"
#include "core/source/chunks/chunk_box.h"

namespace isoscope::testing {

using EncodeFunction = std::function<std::string(const std::string&)>;

// The bytes of an array, C order.
struct PlainArray {
  source::ChunkIndex dims;
  std::size_t element_size = 1;
  std::string bytes{};

  // Bytes that differ from one element to the next.
  static PlainArray Counting(source::ChunkIndex dims, std::size_t element_size) {
    PlainArray array{.dims = std::move(dims), .element_size = element_size};
    std::size_t count = 1;
    for (const std::int64_t size : array.dims) {
      count *= static_cast<std::size_t>(size);
    }
    for (std::uint64_t i = 0; i < count; ++i) {
      std::string number;
      base::AppendLittleEndian(i * 2654435761U + 17, &number);
      array.bytes += number.substr(0, element_size);
    }
    return array;
  }
  [[nodiscard]] std::string At(const source::ChunkIndex& index) const {
    std::size_t number = 0;
    for (std::size_t axis = 0; axis < dims.size(); ++axis) {
      number =
          number * static_cast<std::size_t>(dims[axis]) + static_cast<std::size_t>(index[axis]);
    }
    return bytes.substr(number * element_size, element_size);
  }
  // The elements of a box, C order; `fill` beyond the end of the array.
  [[nodiscard]] std::string Cut(const source::ChunkBox& box, const std::string& fill) const {
    std::string cut;
    source::ChunkIndex index = box.begin;
    do {
      bool is_inside = true;
      for (std::size_t axis = 0; axis < dims.size(); ++axis) {
        is_inside = is_inside && index[axis] < dims[axis];
      }
      cut += is_inside ? At(index) : fill;
    } while (source::NextIndex(box, &index));
    return cut;
  }
};

inline std::string WithCrc32c(const std::string& bytes) {
  std::string all = bytes;
  base::AppendLittleEndian(base::Crc32c(bytes), &all);
  return all;
}

// A shard of encoded chunks, in C order; those without bytes are missing. The chunks lie in the
// order of `order` (numbers of chunks; empty: as they are counted), with `gap` bytes in front of
// each.
struct ShardFile {
  std::vector<std::optional<std::string>> chunks{};
  bool is_index_at_end = true;
  bool has_checksum = true;
  std::vector<std::size_t> order{};
  std::size_t gap = 0;

  [[nodiscard]] std::string Bytes() const {
    std::vector<std::size_t> numbers = order;
    for (std::size_t i = 0; order.empty() && i < chunks.size(); ++i) {
      numbers.push_back(i);
    }
    const std::size_t index_bytes = 16 * chunks.size() + (has_checksum ? 4 : 0);
    std::string data(is_index_at_end ? 0 : index_bytes, '\0');
    std::vector<std::uint64_t> entries(2 * chunks.size(), ~std::uint64_t{0});
    for (const std::size_t number : numbers) {
      if (chunks[number].has_value()) {
        data += std::string(gap, 'g');
        entries[2 * number] = data.size();
        entries[2 * number + 1] = chunks[number]->size();
        data += *chunks[number];
      }
    }
    std::string index;
    for (const std::uint64_t number : entries) {
      base::AppendLittleEndian(number, &index);
    }
    index = has_checksum ? WithCrc32c(index) : index;
    return is_index_at_end ? data + index : index + data.substr(index_bytes);
  }
};

// How an array is cut.
struct WrittenChunks {
  source::ChunkIndex chunk_dims{};
  source::ChunkIndex shard_dims{};  // empty: no shards
  EncodeFunction encode = [](const std::string& bytes) { return bytes; };
  ShardFile shard{};  // its order and places
  std::string fill{};
  // Chunks of these numbers are left out, counted over the whole array.
  std::function<bool(std::int64_t)> is_missing = [](std::int64_t) { return false; };
};

// The objects of an array, by the key of their index.
inline std::map<std::string, std::string> WriteChunks(
    const PlainArray& array, const WrittenChunks& written,
    const std::function<std::string(const source::ChunkIndex&)>& key_of) {
  std::map<std::string, std::string> objects;
  const source::ChunkGrid chunks(array.dims, written.chunk_dims);
  const auto chunk_at = [&](const source::ChunkIndex& index) -> std::optional<std::string> {
    for (std::size_t axis = 0; axis < index.size(); ++axis) {
      if (index[axis] >= chunks.counts()[axis]) {
        return std::nullopt;  // of a shard beyond the end of the array
      }
    }
    if (written.is_missing(chunks.NumberOf(index))) {
      return std::nullopt;
    }
    return written.encode(array.Cut(chunks.ElementsOf(index), written.fill));
  };
  const bool has_shards = !written.shard_dims.empty();
  const source::ChunkGrid files(array.dims, has_shards ? written.shard_dims : written.chunk_dims);
  const source::ChunkBox all = source::BoxOf(files.counts());
  source::ChunkIndex file = all.begin;
  do {
    if (!has_shards) {
      if (auto bytes = chunk_at(file); bytes.has_value()) {
        objects[key_of(file)] = *bytes;
      }
      continue;
    }
    const source::ChunkGrid inner(written.shard_dims, written.chunk_dims);
    ShardFile shard = written.shard;
    source::ChunkIndex index(file.size(), 0);
    bool is_there = false;
    do {
      source::ChunkIndex chunk = index;
      for (std::size_t axis = 0; axis < chunk.size(); ++axis) {
        chunk[axis] += file[axis] * inner.counts()[axis];
      }
      shard.chunks.push_back(chunk_at(chunk));
      is_there = is_there || shard.chunks.back().has_value();
    } while (source::NextIndex(source::BoxOf(inner.counts()), &index));
    if (is_there) {
      objects[key_of(file)] = shard.Bytes();
    }
  } while (source::NextIndex(all, &file));
  return objects;
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_CHUNK_WRITER_H_
