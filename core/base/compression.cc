#include "core/base/compression.h"

#include <zstd.h>

#include <memory>

#include "absl/status/status.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"

namespace isoscope::base {
namespace {

// The fastest of the regular levels: messages are sent once.
constexpr int kLevel = 1;

struct FreeContext {
  void operator()(ZSTD_CCtx* context) const { ZSTD_freeCCtx(context); }
  void operator()(ZSTD_DCtx* context) const { ZSTD_freeDCtx(context); }
};

}  // namespace

std::string Compress(absl::string_view bytes) {
  std::string frame(ZSTD_compressBound(bytes.size()), '\0');
  // Making a context costs more than compressing a small message.
  thread_local const std::unique_ptr<ZSTD_CCtx, FreeContext> context(ZSTD_createCCtx());
  ISOSCOPE_CHECK(context != nullptr);
  const std::size_t size = ZSTD_compressCCtx(context.get(), frame.data(), frame.size(),
                                             bytes.data(), bytes.size(), kLevel);
  ISOSCOPE_CHECK(!ZSTD_isError(size));
  frame.resize(size);
  return frame;
}

absl::StatusOr<std::string> Decompress(absl::string_view frame, std::size_t max_size) {
  const unsigned long long stated = ZSTD_getFrameContentSize(frame.data(), frame.size());
  if (stated == ZSTD_CONTENTSIZE_ERROR || stated == ZSTD_CONTENTSIZE_UNKNOWN) {
    return absl::DataLossError(absl::StrFormat(
        "%d compressed bytes: no Zstandard frame with a content size", frame.size()));
  }
  if (stated > max_size) {
    return absl::DataLossError(
        absl::StrFormat("compressed frame states %d bytes, at most %d expected", stated, max_size));
  }
  const std::size_t frame_size = ZSTD_findFrameCompressedSize(frame.data(), frame.size());
  if (ZSTD_isError(frame_size) || frame_size != frame.size()) {
    return absl::DataLossError(absl::StrFormat(
        "compressed frame of %d bytes is truncated or followed by other bytes", frame.size()));
  }
  std::string bytes(static_cast<std::size_t>(stated), '\0');
  thread_local const std::unique_ptr<ZSTD_DCtx, FreeContext> context(ZSTD_createDCtx());
  ISOSCOPE_CHECK(context != nullptr);
  const std::size_t size =
      ZSTD_decompressDCtx(context.get(), bytes.data(), bytes.size(), frame.data(), frame.size());
  if (ZSTD_isError(size)) {
    return absl::DataLossError(
        absl::StrFormat("compressed frame is damaged: %s", ZSTD_getErrorName(size)));
  }
  if (size != bytes.size()) {
    return absl::DataLossError(
        absl::StrFormat("compressed frame holds %d bytes, states %d", size, bytes.size()));
  }
  return bytes;
}

}  // namespace isoscope::base
