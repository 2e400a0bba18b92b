#include "core/index/node_writer.h"

#include <cstddef>

#include "absl/status/statusor.h"

#include "core/base/coding.h"
#include "core/base/status_macros.h"

namespace isoscope::index {

absl::Status EntryRunWriter::Append(const BlockInterval& interval) {
  char bytes[format::kEntryBytes];
  format::EncodeEntry(interval, bytes);
  payload_.append(bytes, sizeof(bytes));
  ++entry_count_;
  return ++page_entry_count_ == format::kEntriesPerPage ? Finish() : absl::OkStatus();
}

absl::Status EntryRunWriter::Finish() {
  if (page_entry_count_ == 0) {
    return absl::OkStatus();
  }
  base::StoreLittleEndian(static_cast<std::uint16_t>(page_entry_count_), &payload_[2]);
  ISOSCOPE_RETURN_IF_ERROR(pages_->Append(payload_).status());
  StartPage();
  return absl::OkStatus();
}

void EntryRunWriter::StartPage() {
  payload_.assign(format::kEntryPageHeaderBytes, '\0');
  base::StoreLittleEndian(format::kEntryPageKind, payload_.data());
  page_entry_count_ = 0;
}

NodeRecords::NodeRecords(std::span<const double> lower) : slabs(lower.size()) {
  for (std::size_t slab = 0; slab < lower.size(); ++slab) {
    slabs[slab].lower = lower[slab];
  }
  header.slab_count = static_cast<std::uint16_t>(lower.size());
}

std::string NodeRecords::Encode() const {
  std::string payload(format::SlabRecordOffset(static_cast<std::int64_t>(slabs.size())), '\0');
  format::EncodeNodeHeader(header, payload.data());
  for (std::size_t slab = 0; slab < slabs.size(); ++slab) {
    format::EncodeSlabRecord(slabs[slab],
                             &payload[format::SlabRecordOffset(static_cast<std::int64_t>(slab))]);
  }
  return payload;
}

}  // namespace isoscope::index
