// One child for each open source, which holds the library's own source. Both processes are one
// program, so that a request can name the library by its functions:
//
//   request          the child                          answer             memory that both see
//   kOpen            opens the source, and keeps it     header             name
//   kReadRows        reads rows of it                   -                  the rows
//   kFindFiles       -                                  -                  names, each ends with 0
//   kDescribe        -                                  -                  texts, each ends with 0
//   an error of any                                     code               message
//
// Rows are read in runs: a plane, or as many as fit into kRunBytes. So a library that decodes in
// chunks gets requests as large as without the child. After an error there are no more requests,
// because the state of the library after a damaged file is unknown.

#include "core/source/child/walled_source.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/source/child/decoder_process.h"
#include "core/source/child/far_files.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kRunBytes = 8 * base::kMiB;
constexpr std::size_t kSharedBytes = 32 * base::kMiB;  // memory only as far as it is used

enum class Question : std::uint32_t { kOpen, kReadRows, kFindFiles, kDescribe };

struct Request {
  WalledLibrary library;
  Question question;
  std::int64_t begin_row;
  std::int64_t end_row;
  std::array<char, 4096> path;  // ends with 0
  std::array<char, 256> part;   // ends with 0
};

struct Header {
  volume::GridGeometry geometry;
  volume::ScalarType type;
  std::uint8_t is_seekable;        // 0 or 1
  std::uint8_t has_patient_frame;  // 0 or 1: LPS
  std::int64_t memory_bytes;
};

struct Answer {
  std::uint32_t is_answered;  // 1; else the child stopped half-way
  std::int32_t code;          // of absl::StatusCode
  std::uint64_t text_bytes;   // of the message, the name or the names
  Header header;
};

// ---- The child. -------------------------------------------------------------------------------

void PutText(absl::string_view text, Answer* answer, char* shared) {
  answer->text_bytes = std::min(text.size(), kSharedBytes);
  std::memcpy(shared, text.data(), answer->text_bytes);
}

absl::Status DoInChild(const Request& request, Answer* answer, char* shared) {
  static std::unique_ptr<VolumeSource> source;  // of this child
  const std::string path = request.path.data();
  const std::string part = request.part.data();
  if (request.question == Question::kFindFiles || request.question == Question::kDescribe) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> texts,
                              request.question == Question::kFindFiles
                                  ? request.library.find_files(path)
                                  : request.library.describe(path, part));
    std::string names;
    for (const std::string& text : texts) {
      names.append(text.c_str(), text.size() + 1);
    }
    if (names.size() > kSharedBytes) {
      return absl::InvalidArgumentError(
          absl::StrCat(path, ": too many files or steps: ", names.size(), " bytes of names"));
    }
    PutText(names, answer, shared);
    return absl::OkStatus();
  }
  if (request.question == Question::kReadRows) {
    if (source == nullptr) {  // somebody killed the child that had it
      ISOSCOPE_ASSIGN_OR_RETURN(source, request.library.open(path, part));
    }
    return source->ReadRows(request.begin_row, request.end_row, shared);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(source, request.library.open(path, part));
  const SourceInfo& info = source->info();
  answer->header = {.geometry = info.geometry,
                    .type = info.type,
                    .is_seekable = static_cast<std::uint8_t>(info.is_seekable ? 1 : 0),
                    .has_patient_frame = static_cast<std::uint8_t>(
                        info.patient_frame == volume::PatientFrame() ? 1 : 0),
                    .memory_bytes = info.memory_bytes};
  PutText(info.name, answer, shared);
  return absl::OkStatus();
}

void HandleInChild(const void* request_bytes, void* answer_bytes, char* shared) {
  Request request;
  std::memcpy(static_cast<void*>(&request), request_bytes, sizeof(request));
  Answer answer{};
  absl::Status status = DoInChild(request, &answer, shared);
  if (const absl::Status far = FarFiles::ErrorInChild(); !far.ok()) {
    status = far;  // whatever the library made of it
  }
  if (!status.ok()) {
    PutText(status.message(), &answer, shared);
  }
  answer.code = static_cast<std::int32_t>(status.code());
  answer.is_answered = 1;
  std::memcpy(answer_bytes, &answer, sizeof(answer));
}

// ---- The parent: the child may have been overrun, and nothing it says is taken for granted. -----

class Child {
 public:
  Child(const WalledLibrary& library, const std::string& path, const std::string& part)
      : library_(library),
        path_(path),
        part_(part),
        process_({.handler = HandleInChild,
                  .request_bytes = sizeof(Request),
                  .answer_bytes = sizeof(Answer),
                  .shared_bytes = kSharedBytes}) {}

  // Later questions are about another file.
  void TurnTo(const std::string& path) { path_ = path; }

  // Returns the answer, the error that the child reported, or the error that ended it.
  absl::StatusOr<Answer> Ask(Question question, const DecoderProcess::Limits& limits,
                             std::int64_t begin_row = 0, std::int64_t end_row = 0) {
    Request request{};
    if (path_.size() >= request.path.size() || part_.size() >= request.part.size()) {
      return absl::InvalidArgumentError(absl::StrCat(path_, ": the path is too long"));
    }
    request.library = library_;
    request.question = question;
    request.begin_row = begin_row;
    request.end_row = end_row;
    path_.copy(request.path.data(), path_.size());
    part_.copy(request.part.data(), part_.size());
    Answer answer{};
    const absl::Status asked = process_.Ask(request, limits, &answer);
    if (absl::IsUnavailable(asked)) {
      return Damaged(asked.message());
    }
    if (!asked.ok()) {
      return absl::Status(asked.code(), absl::StrCat(path_, ": ", asked.message()));
    }
    const bool is_code = answer.code >= 0 && answer.code <= 16;  // absl::StatusCode
    if (answer.is_answered != 1 || !is_code || answer.text_bytes > kSharedBytes) {
      return Damaged("its answer makes no sense");
    }
    if (answer.code != 0) {
      return absl::Status(static_cast<absl::StatusCode>(answer.code), Text(answer));
    }
    return answer;
  }

  // Returns the text of an answer, without control characters, so that it can't steer a terminal.
  [[nodiscard]] std::string Text(const Answer& answer) const {
    std::string text(process_.shared(), answer.text_bytes);
    std::replace_if(
        text.begin(), text.end(),
        [](char c) { return absl::ascii_iscntrl(static_cast<unsigned char>(c)) && c != '\0'; },
        '?');
    return text;
  }
  [[nodiscard]] absl::Status Damaged(absl::string_view why) const {
    return absl::DataLossError(absl::StrCat(
        path_, ": can't be read by ", library_.name, ", which has a process of its own: ", why,
        ": the file is damaged, or needs more memory than there is; copy it again"));
  }
  [[nodiscard]] const char* shared() const { return process_.shared(); }

 private:
  const WalledLibrary library_;
  std::string path_;
  const std::string part_;
  DecoderProcess process_;
};

class WalledSource final : public VolumeSource {
 public:
  // `info`: as the child has it.
  WalledSource(std::unique_ptr<Child> child, const SourceInfo& info, std::int64_t library_bytes)
      : VolumeSource(WithRun(info)),
        child_(std::move(child)),
        limits_{.memory_bytes = library_bytes + 2 * info.memory_bytes} {}

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    ISOSCOPE_CHECK(begin_row >= 0 && begin_row < end_row && end_row <= RowCount(info()));
    ISOSCOPE_RETURN_IF_ERROR(failure_);
    const std::int64_t plane_rows = info().geometry.sample_dims.y;
    const std::int64_t row_bytes = info().row_bytes();
    const std::int64_t run_rows = RunRows(info());
    while (begin_row < end_row) {
      // First up to the end of a plane, then as many whole planes as fit.
      const std::int64_t in_plane = begin_row % plane_rows;
      const std::int64_t run = in_plane > 0            ? plane_rows - in_plane
                               : run_rows > plane_rows ? run_rows - run_rows % plane_rows
                                                       : run_rows;
      const std::int64_t rows = std::min({end_row - begin_row, run_rows, run});
      failure_ = child_->Ask(Question::kReadRows, limits_, begin_row, begin_row + rows).status();
      ISOSCOPE_RETURN_IF_ERROR(failure_);
      std::memcpy(out, child_->shared(), static_cast<std::size_t>(rows * row_bytes));
      out += rows * row_bytes;
      begin_row += rows;
    }
    return absl::OkStatus();
  }

 private:
  static std::int64_t RowCount(const SourceInfo& info) {
    return info.geometry.sample_dims.y * info.geometry.sample_dims.z;
  }
  static std::int64_t RunRows(const SourceInfo& info) {
    return std::min(std::max(kRunBytes / info.row_bytes(), info.geometry.sample_dims.y),
                    static_cast<std::int64_t>(kSharedBytes) / info.row_bytes());
  }
  static SourceInfo WithRun(SourceInfo info) {
    info.memory_bytes += std::min(RunRows(info), RowCount(info)) * info.row_bytes();
    return info;
  }

  const std::unique_ptr<Child> child_;
  const DecoderProcess::Limits limits_;
  absl::Status failure_;  // the first one; it stays
};

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenWalled(const WalledLibrary& library,
                                                         const std::string& path,
                                                         const std::string& part) {
  auto child = std::make_unique<Child>(library, path, part);
  ISOSCOPE_ASSIGN_OR_RETURN(const Answer answer,
                            child->Ask(Question::kOpen, {.memory_bytes = library.memory_bytes}));
  const Header& header = answer.header;
  constexpr std::int64_t kMaxMemoryBytes = std::int64_t{1} << 40;
  const bool has_type =
      header.type >= volume::ScalarType::kUint8 && header.type <= volume::ScalarType::kFloat64;
  if (!has_type || header.memory_bytes < 0 || header.memory_bytes > kMaxMemoryBytes ||
      !volume::Validate(header.geometry).ok()) {
    return child->Damaged("its answer makes no sense");
  }
  SourceInfo info{.name = child->Text(answer),
                  .geometry = header.geometry,
                  .type = header.type,
                  .is_seekable = header.is_seekable == 1,
                  .memory_bytes = header.memory_bytes};
  if (header.has_patient_frame == 1) {
    info.patient_frame.emplace();
  }
  if (info.row_bytes() > static_cast<std::int64_t>(kSharedBytes)) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": rows of ", info.row_bytes(),
                                                   " bytes; expected at most ", kSharedBytes));
  }
  return std::make_unique<WalledSource>(std::move(child), info, library.memory_bytes);
}

absl::StatusOr<std::vector<std::string>> FindFilesWalled(const WalledLibrary& library,
                                                         const std::vector<std::string>& paths) {
  std::vector<std::string> files;
  Child child(library, "", "");
  for (const std::string& path : paths) {
    child.TurnTo(path);
    ISOSCOPE_ASSIGN_OR_RETURN(
        const Answer answer,
        child.Ask(Question::kFindFiles, {.memory_bytes = library.memory_bytes}));
    for (const absl::string_view file : absl::StrSplit(
             absl::string_view(child.shared(), answer.text_bytes), '\0', absl::SkipEmpty())) {
      files.emplace_back(file);
    }
  }
  return files;
}

absl::StatusOr<std::vector<std::string>> DescribeWalled(const WalledLibrary& library,
                                                        const std::string& path,
                                                        const std::string& part) {
  Child child(library, path, part);
  ISOSCOPE_ASSIGN_OR_RETURN(const Answer answer,
                            child.Ask(Question::kDescribe, {.memory_bytes = library.memory_bytes}));
  return absl::StrSplit(child.Text(answer), '\0', absl::SkipEmpty());
}

}  // namespace isoscope::source
