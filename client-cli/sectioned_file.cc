#include "client-cli/sectioned_file.h"

#include <algorithm>

#include "absl/strings/str_cat.h"

#include "client-cli/output.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"

namespace isoscope::cli {
namespace {

constexpr std::int64_t kCopyBytes = 4 * base::kMiB;

}  // namespace

SectionedFile::SectionedFile(const std::string& path, std::size_t header_bytes,
                             std::size_t section_count)
    : path_(path), header_bytes_(header_bytes) {
  ISOSCOPE_CHECK_GE(section_count, std::size_t{1});
  for (std::size_t i = 0; i < section_count; ++i) {
    partial_paths_.push_back(i == 0 ? PartialName(path)
                                    : absl::StrCat(PartialName(path), ".section-", i));
  }
}

absl::StatusOr<std::unique_ptr<SectionedFile>> SectionedFile::Create(const std::string& path,
                                                                     std::size_t header_bytes,
                                                                     std::size_t section_count) {
  std::unique_ptr<SectionedFile> file(new SectionedFile(path, header_bytes, section_count));
  for (const std::string& partial : file->partial_paths_) {
    ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(partial));
    ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<io::WritableFile> section,
                              io::CreateWritableFile(partial));
    file->files_.push_back(std::move(section));
  }
  ISOSCOPE_RETURN_IF_ERROR(file->files_[0]->Append(std::string(header_bytes, '\0')));
  return file;
}

SectionedFile::~SectionedFile() {
  // After Finish there is nothing left under these names; before it, an error is on its way.
  for (const std::string& partial : partial_paths_) {
    io::RemoveRecursively(partial).IgnoreError();
  }
}

absl::Status SectionedFile::Append(std::size_t section, absl::string_view bytes) {
  return files_[section]->Append(bytes);
}

std::int64_t SectionedFile::section_bytes(std::size_t section) const {
  return files_[section]->size_bytes() -
         (section == 0 ? static_cast<std::int64_t>(header_bytes_) : 0);
}

absl::Status SectionedFile::AppendSection(std::size_t section) {
  ISOSCOPE_RETURN_IF_ERROR(files_[section]->Close());
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::RandomAccessFile> in,
                            io::OpenRandomAccessFile(partial_paths_[section]));
  std::string buffer;
  for (std::int64_t offset = 0; offset < in->size_bytes(); offset += kCopyBytes) {
    buffer.resize(static_cast<std::size_t>(std::min(kCopyBytes, in->size_bytes() - offset)));
    ISOSCOPE_RETURN_IF_ERROR(in->ReadAt(offset, buffer.size(), buffer.data()));
    ISOSCOPE_RETURN_IF_ERROR(files_[0]->Append(buffer));
  }
  return io::RemoveRecursively(partial_paths_[section]);
}

absl::Status SectionedFile::Finish(absl::string_view header,
                                   const std::vector<std::string>& between,
                                   absl::string_view tail) {
  ISOSCOPE_CHECK_EQ(header.size(), header_bytes_);
  for (std::size_t section = 1; section < files_.size(); ++section) {
    if (section <= between.size()) {
      ISOSCOPE_RETURN_IF_ERROR(files_[0]->Append(between[section - 1]));
    }
    ISOSCOPE_RETURN_IF_ERROR(AppendSection(section));
  }
  ISOSCOPE_RETURN_IF_ERROR(files_[0]->Append(tail));
  ISOSCOPE_RETURN_IF_ERROR(files_[0]->WriteAt(0, header));
  ISOSCOPE_RETURN_IF_ERROR(files_[0]->Close());
  return io::RenamePath(partial_paths_[0], path_);
}

}  // namespace isoscope::cli
