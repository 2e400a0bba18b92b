// Codecs of arrays: "transpose", and "bytes", which makes bytes of numbers.

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/source/bytes/byte_order.h"
#include "core/source/chunks/chunk_codec.h"

namespace isoscope::source {
namespace {

absl::Status CheckIsArray(const ChunkData& data) {
  return data.is_array ? absl::OkStatus()
                       : absl::InvalidArgumentError(
                             "encodes numbers, and a codec in front of it has made bytes of them");
}

class BytesCodec final : public ChunkCodec {
 public:
  BytesCodec(std::size_t number_size, bool is_big_endian)
      : number_size_(number_size), is_big_endian_(is_big_endian) {}
  [[nodiscard]] absl::StatusOr<std::string> Decode(std::string encoded) const override {
    if (is_big_endian_) {
      SwapBytes(number_size_, encoded.size() / number_size_, encoded.data());
    }
    return encoded;
  }
  [[nodiscard]] bool is_identity() const override { return !is_big_endian_ || number_size_ == 1; }

 private:
  const std::size_t number_size_;
  const bool is_big_endian_;
};

absl::StatusOr<std::unique_ptr<ChunkCodec>> MakeBytes(const ChunkJson& configuration,
                                                      ChunkData* data) {
  if (absl::Status status = CheckIsArray(*data); !status.ok()) {
    return status;
  }
  bool is_big = false;
  if (const auto endian = configuration.find("endian");
      endian != configuration.end() && !endian->is_null()) {
    if (*endian != "little" && *endian != "big") {
      return absl::InvalidArgumentError("its endian is neither \"little\" nor \"big\"");
    }
    is_big = *endian == "big";
  }
  data->is_array = false;
  return std::make_unique<BytesCodec>(SizeOf(data->type), is_big);
}

// The array that was stored has axis order[i] of the chunk as its axis i.
class TransposeCodec final : public ChunkCodec {
 public:
  TransposeCodec(std::size_t number_size, std::vector<std::int64_t> dims,
                 std::vector<std::size_t> order)
      : number_size_(number_size), dims_(std::move(dims)), strides_(dims_.size()) {
    auto stride = static_cast<std::int64_t>(number_size_);
    for (std::size_t i = order.size(); i-- > 0;) {
      strides_[order[i]] = stride;
      stride *= dims_[order[i]];
    }
  }

  [[nodiscard]] absl::StatusOr<std::string> Decode(std::string encoded) const override {
    if (encoded.empty() || dims_.empty()) {
      return encoded;
    }
    std::string out(encoded.size(), '\0');
    switch (number_size_) {
      case 1:
        Copy<1>(encoded.data(), out.data());
        break;
      case 2:
        Copy<2>(encoded.data(), out.data());
        break;
      case 4:
        Copy<4>(encoded.data(), out.data());
        break;
      default:
        Copy<8>(encoded.data(), out.data());
    }
    return out;
  }

 private:
  // Writes the chunk from front to back, row by row.
  template <std::size_t size>
  void Copy(const char* in, char* out) const {
    const std::size_t rank = dims_.size();
    const std::int64_t row = dims_[rank - 1];
    const std::int64_t stride = strides_[rank - 1];
    std::vector<std::int64_t> index(rank, 0);  // of the row
    std::int64_t offset = 0;
    while (true) {
      const char* from = in + offset;
      for (std::int64_t i = 0; i < row; ++i, from += stride, out += size) {
        std::memcpy(out, from, size);
      }
      std::size_t axis = rank - 1;
      while (axis-- > 0) {
        offset += strides_[axis];
        if (++index[axis] < dims_[axis]) {
          break;
        }
        offset -= strides_[axis] * dims_[axis];
        index[axis] = 0;
      }
      if (axis == static_cast<std::size_t>(-1)) {
        return;
      }
    }
  }

  const std::size_t number_size_;
  const std::vector<std::int64_t> dims_;  // of the chunk
  std::vector<std::int64_t> strides_;     // in the stored array, by axis of the chunk; bytes
};

absl::StatusOr<std::vector<std::size_t>> OrderOf(const ChunkJson& configuration, std::size_t rank) {
  const auto found = configuration.find("order");
  std::vector<std::size_t> order;
  if (found != configuration.end() && (*found == "C" || *found == "F")) {
    for (std::size_t i = 0; i < rank; ++i) {
      order.push_back(*found == "C" ? i : rank - 1 - i);
    }
    return order;
  }
  std::vector<bool> is_used(rank, false);
  if (found != configuration.end() && found->is_array() && found->size() == rank) {
    for (const ChunkJson& axis : *found) {
      if (!axis.is_number_integer() || axis < 0 || axis >= rank ||
          is_used[axis.get<std::size_t>()]) {
        break;
      }
      order.push_back(axis.get<std::size_t>());
      is_used[order.back()] = true;
    }
  }
  return order.size() == rank
             ? absl::StatusOr<std::vector<std::size_t>>(std::move(order))
             : absl::InvalidArgumentError(absl::StrFormat(
                   "its order does not name each of the %d axes once; expected a list such "
                   "as [2, 1, 0]",
                   rank));
}

absl::StatusOr<std::unique_ptr<ChunkCodec>> MakeTranspose(const ChunkJson& configuration,
                                                          ChunkData* data) {
  if (absl::Status status = CheckIsArray(*data); !status.ok()) {
    return status;
  }
  auto order = OrderOf(configuration, data->dims.size());
  if (!order.ok()) {
    return order.status();
  }
  const std::vector<std::int64_t> dims = data->dims;
  for (std::size_t i = 0; i < dims.size(); ++i) {
    data->dims[i] = dims[(*order)[i]];
  }
  return std::make_unique<TransposeCodec>(SizeOf(data->type), dims, *std::move(order));
}

}  // namespace

absl::Span<const CodecRow> ArrayCodecs() {
  static constexpr CodecRow kRows[] = {
      {"bytes", MakeBytes},
      {"endian", MakeBytes},  // the name before Zarr 3 was final
      {"transpose", MakeTranspose},
  };
  return kRows;
}

}  // namespace isoscope::source
