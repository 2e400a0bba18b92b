#include "clients/cpp/mesh_file/sectioned_file.h"

#include <algorithm>

#include "absl/strings/str_cat.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"

namespace isoscope::client {
namespace {

constexpr std::int64_t kCopyBytes = 4 * base::kMiB;

}  // namespace

absl::StatusOr<std::unique_ptr<SectionedFile>> SectionedFile::Create(const std::string& path,
                                                                     std::size_t header_bytes,
                                                                     std::size_t section_count) {
  ISOSCOPE_CHECK_GE(section_count, std::size_t{1});
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<io::AtomicFile> whole, io::AtomicFile::Create(path));
  std::unique_ptr<SectionedFile> file(new SectionedFile(header_bytes, std::move(whole)));
  for (std::size_t i = 1; i < section_count; ++i) {
    const std::string partial = absl::StrCat(io::PartialName(path), ".section-", i);
    ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(partial));
    ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<io::WritableFile> section,
                              io::CreateWritableFile(partial));
    file->later_sections_.push_back({partial, std::move(section)});
  }
  ISOSCOPE_RETURN_IF_ERROR(file->file_->Append(std::string(header_bytes, '\0')));
  return file;
}

SectionedFile::~SectionedFile() {
  // After Finish no files with these names exist; before it, another error is reported.
  for (const Section& section : later_sections_) {
    io::RemoveRecursively(section.path).IgnoreError();
  }
}

absl::Status SectionedFile::Append(std::size_t section, absl::string_view bytes) {
  return section == 0 ? file_->Append(bytes) : later_sections_[section - 1].file->Append(bytes);
}

std::int64_t SectionedFile::section_bytes(std::size_t section) const {
  return section == 0 ? file_->size_bytes() - static_cast<std::int64_t>(header_bytes_)
                      : later_sections_[section - 1].file->size_bytes();
}

DiskUse SectionedFile::disk_use() const {
  std::int64_t largest = 0;  // of those that are on disk twice while they are appended
  DiskUse use;
  for (std::size_t section = 0; section <= later_sections_.size(); ++section) {
    use.file_bytes += section_bytes(section);
    if (section > 0) {
      largest = std::max(largest, section_bytes(section));
    }
  }
  use.peak_bytes = use.file_bytes + largest;
  return use;
}

absl::Status SectionedFile::AppendSection(const Section& section) {
  ISOSCOPE_RETURN_IF_ERROR(section.file->Close());
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::RandomAccessFile> in,
                            io::OpenRandomAccessFile(section.path));
  std::string buffer;
  for (std::int64_t offset = 0; offset < in->size_bytes(); offset += kCopyBytes) {
    buffer.resize(static_cast<std::size_t>(std::min(kCopyBytes, in->size_bytes() - offset)));
    ISOSCOPE_RETURN_IF_ERROR(in->ReadAt(offset, buffer.size(), buffer.data()));
    ISOSCOPE_RETURN_IF_ERROR(file_->Append(buffer));
  }
  return io::RemoveRecursively(section.path);
}

absl::Status SectionedFile::Finish(absl::string_view header,
                                   const std::vector<std::string>& between,
                                   absl::string_view tail) {
  ISOSCOPE_CHECK_EQ(header.size(), header_bytes_);
  for (std::size_t i = 0; i < later_sections_.size(); ++i) {
    if (i < between.size()) {
      ISOSCOPE_RETURN_IF_ERROR(file_->Append(between[i]));
    }
    ISOSCOPE_RETURN_IF_ERROR(AppendSection(later_sections_[i]));
  }
  ISOSCOPE_RETURN_IF_ERROR(file_->Append(tail));
  ISOSCOPE_RETURN_IF_ERROR(file_->WriteAt(0, header));
  return file_->Commit();
}

}  // namespace isoscope::client
