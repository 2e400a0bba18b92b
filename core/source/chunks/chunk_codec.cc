#include "core/source/chunks/chunk_codec.h"

#include <algorithm>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"

#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/source/chunks/shard_layout.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kMaxCodecs = 32;

std::vector<absl::Span<const CodecRow>> CodecTables() {
  return {ArrayCodecs(), ByteCodecs(), NumberCodecs(), ShardCodecs()};
}

// "numcodecs.zlib" is "zlib" as numcodecs has it.
MakeChunkCodec FindCodec(absl::string_view name) {
  absl::ConsumePrefix(&name, "numcodecs.");
  for (const absl::Span<const CodecRow> table : CodecTables()) {
    for (const CodecRow& row : table) {
      if (row.name == name) {
        return row.make;
      }
    }
  }
  return nullptr;
}

// Why a codec that others know is refused.
absl::string_view RefusalOf(absl::string_view name) {
  absl::ConsumePrefix(&name, "numcodecs.");
  if (name == "blosc2") {
    return "for which Debian has no library";
  }
  if (name == "zfpy" || name == "zfp" || name == "pcodec" || name == "jpeg" || name == "jpeg2k" ||
      name == "jpegxl" || name == "imagecodecs_jpeg2k") {
    return "which is not read";
  }
  return "which is unknown";
}

absl::Status NamedCodec(absl::string_view name, const absl::Status& status) {
  return absl::Status(status.code(),
                      absl::StrFormat("codec \"%s\": %s", base::Printable(name), status.message()));
}

}  // namespace

std::string CodecNames() {
  std::set<std::string> names;
  for (const absl::Span<const CodecRow> table : CodecTables()) {
    for (const CodecRow& row : table) {
      names.emplace(row.name);
    }
  }
  return absl::StrJoin(names, ", ");
}

std::int64_t MaxCompressedBytes(std::int64_t size_bytes) {
  constexpr std::int64_t kHead = 4 * base::kKiB;         // each of a shard's chunks has one
  constexpr std::int64_t kMost = std::int64_t{1} << 60;  // no memory has so much
  return size_bytes >= kMost ? size_bytes : size_bytes + size_bytes / 4 + kHead;
}

ChunkData ArrayData(std::vector<std::int64_t> dims, NumberType type, std::string fill) {
  ChunkData data{.dims = std::move(dims), .type = type, .fill = std::move(fill)};
  data.size_bytes = static_cast<std::int64_t>(SizeOf(type));
  for (const std::int64_t size : data.dims) {
    data.size_bytes *= size;
  }
  return data;
}

absl::StatusOr<std::vector<CodecSpec>> CodecSpecsFrom(const ChunkJson& list) {
  if (!list.is_array()) {
    return absl::InvalidArgumentError("its codecs are no list; expected one");
  }
  std::vector<CodecSpec> specs;
  for (const ChunkJson& item : list) {
    if (specs.size() > kMaxCodecs) {
      break;  // Make refuses them
    }
    if (item.is_string()) {
      specs.push_back({.name = item.get<std::string>()});
      continue;
    }
    const auto name = item.is_object() ? item.find("name") : item.end();
    if (!item.is_object() || name == item.end() || !name->is_string()) {
      return absl::InvalidArgumentError("a codec has no name");
    }
    CodecSpec& spec = specs.emplace_back();
    spec.name = name->get<std::string>();
    if (const auto found = item.find("configuration"); found != item.end() && !found->is_null()) {
      if (!found->is_object()) {
        return absl::InvalidArgumentError(absl::StrFormat(
            "codec \"%s\": its configuration is no object", base::Printable(spec.name)));
      }
      spec.configuration = *found;
    }
  }
  return specs;
}

absl::StatusOr<CodecChain> CodecChain::Make(absl::Span<const CodecSpec> specs, ChunkData decoded) {
  if (specs.size() > kMaxCodecs) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%d codecs; expected at most %d", specs.size(), kMaxCodecs));
  }
  CodecChain chain;
  chain.stages_ = {decoded};
  ChunkData data = std::move(decoded);
  for (const CodecSpec& spec : specs) {
    const MakeChunkCodec make = FindCodec(spec.name);
    if (make == nullptr) {
      constexpr std::size_t kMaxShown = 80;
      return absl::InvalidArgumentError(absl::StrFormat(
          "codec \"%s\", %s; expected some of %s: write the array again with one of these",
          base::Printable(absl::string_view(spec.name).substr(0, kMaxShown)), RefusalOf(spec.name),
          CodecNames()));
    }
    auto codec = make(spec.configuration, &data);
    if (!codec.ok()) {
      return NamedCodec(spec.name, codec.status());
    }
    chain.codecs_.push_back(*std::move(codec));
    chain.names_.push_back(spec.name);
    chain.stages_.push_back(data);
  }
  if (data.is_array) {
    return absl::InvalidArgumentError(
        "no codec makes bytes of the numbers; expected \"bytes\" or \"sharding_indexed\"");
  }
  return chain;
}

absl::Status ChunkCodec::DecodeInto(absl::string_view encoded, std::string* out) const {
  ISOSCOPE_ASSIGN_OR_RETURN(*out, Decode(std::string(encoded)));
  return absl::OkStatus();
}

absl::StatusOr<std::string> CodecChain::Decode(absl::string_view encoded) const {
  std::string bytes;
  ISOSCOPE_RETURN_IF_ERROR(DecodeInto(encoded, &bytes));
  return bytes;
}

absl::Status CodecChain::DecodeInto(absl::string_view encoded, std::string* out) const {
  ISOSCOPE_RETURN_IF_ERROR(CheckSize(codecs_.size(), encoded.size()));
  bool is_in_out = false;  // else nothing was decoded yet
  for (std::size_t i = codecs_.size(); i-- > 0;) {
    const ChunkCodec& codec = *codecs_[i];
    if (!codec.is_identity()) {
      absl::Status status;
      if (is_in_out) {
        auto decoded = codec.Decode(std::move(*out));
        status = decoded.status();
        *out = decoded.ok() ? *std::move(decoded) : "";
      } else {
        status = codec.DecodeInto(encoded, out);
        is_in_out = true;
      }
      if (!status.ok()) {
        return NamedCodec(names_[i], status);
      }
    }
    ISOSCOPE_RETURN_IF_ERROR(CheckSize(i, is_in_out ? out->size() : encoded.size()));
  }
  if (!is_in_out) {
    out->assign(encoded.data(), encoded.size());
  }
  return absl::OkStatus();
}

absl::Status CodecChain::CheckSize(std::size_t stage, std::size_t size) const {
  const ChunkData& data = stages_[stage];
  const auto actual = static_cast<std::int64_t>(size);
  return actual > data.size_bytes || (data.is_exact && actual != data.size_bytes)
             ? absl::DataLossError(absl::StrFormat(
                   "%d bytes%s; expected %s%d: it is damaged or cut", actual,
                   stage == codecs_.size() ? ""
                                           : absl::StrCat(" behind codec \"", names_[stage], "\""),
                   data.is_exact ? "" : "at most ", data.size_bytes))
             : absl::OkStatus();
}

std::int64_t CodecChain::memory_bytes() const {
  std::int64_t most = stages_.front().size_bytes;
  for (std::size_t i = 1; i < stages_.size(); ++i) {
    most = std::max(most, stages_[i - 1].size_bytes + stages_[i].size_bytes);
  }
  return most;
}

}  // namespace isoscope::source
