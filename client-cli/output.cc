#include "client-cli/output.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <fstream>
#include <ostream>
#include <system_error>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"

#include "core/base/check.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/cli/usage.h"
#include "core/io/file.h"

namespace isoscope::cli {
namespace {

constexpr int kBarWidth = 24;

// Puts a comma before every third digit of the whole part.
std::string WithSeparators(const std::string& number) {
  const std::size_t begin = number[0] == '-' ? 1 : 0;
  const std::size_t end = std::min(number.find('.'), number.size());
  std::string grouped = number.substr(0, begin);
  for (std::size_t i = begin; i < end; ++i) {
    if (i > begin && (end - i) % 3 == 0) {
      grouped += ',';
    }
    grouped += number[i];
  }
  return grouped + number.substr(end);
}

std::vector<std::string> AllPrintable(std::vector<std::string> cells) {
  for (std::string& cell : cells) {
    cell = base::Printable(cell);
  }
  return cells;
}

bool IsSpecialFile(const std::string& path) {
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(path, error);
  return std::filesystem::exists(status) && std::filesystem::is_other(status);
}

}  // namespace

std::string FormatCount(std::int64_t value) { return WithSeparators(absl::StrCat(value)); }

std::string FormatMebibytes(std::int64_t bytes) {
  return WithSeparators(absl::StrFormat(
             "%.1f", static_cast<double>(bytes) / static_cast<double>(base::kMiB))) +
         " MiB";
}

std::string FormatMilliseconds(double milliseconds) {
  return WithSeparators(absl::StrFormat("%.1f", milliseconds));
}

std::string FormatElapsed(absl::Duration duration) {
  const std::int64_t seconds = absl::ToInt64Seconds(duration + absl::Milliseconds(500));
  if (seconds < 60) {
    return absl::StrFormat("%d s", seconds);
  }
  if (seconds < 3600) {
    return absl::StrFormat("%d min %02d s", seconds / 60, seconds % 60);
  }
  return absl::StrFormat("%d h %02d min", seconds / 3600, seconds / 60 % 60);
}

Table::Table(std::vector<std::string> header) { rows_.push_back(AllPrintable(std::move(header))); }

void Table::AddRow(std::vector<std::string> cells) {
  ISOSCOPE_CHECK_EQ(cells.size(), rows_[0].size());
  rows_.push_back(AllPrintable(std::move(cells)));
}

std::vector<std::string> WrapText(absl::string_view text, std::size_t width) {
  std::vector<std::string> lines;
  while (text.size() > width) {
    // The last place where a line of this width may end.
    const std::size_t space = text.rfind(' ', width);
    const std::size_t joint = text.find_last_of(",/", width - 1);
    std::size_t end = space == absl::string_view::npos ? 0 : space;
    end = std::max(end, joint == absl::string_view::npos ? 0 : joint + 1);
    end = end == 0 ? width : end;
    // A character of UTF-8 is not cut, if one fits at all.
    std::size_t whole = end;
    while (whole > 0 && (static_cast<unsigned char>(text[whole]) & 0xc0U) == 0x80) {
      --whole;
    }
    end = whole > 0 ? whole : end;
    lines.emplace_back(text.substr(0, end));
    text.remove_prefix(end);
    text.remove_prefix(std::min(text.find_first_not_of(' '), text.size()));
  }
  if (!text.empty() || lines.empty()) {
    lines.emplace_back(text);
  }
  return lines;
}

std::string Table::Part(std::size_t begin, std::size_t end,
                        const std::vector<std::size_t>& widths) const {
  std::vector<std::size_t> columns = {0};
  for (std::size_t column = std::max<std::size_t>(begin, 1); column < end; ++column) {
    columns.push_back(column);
  }
  // Columns of text that goes on in the next line begin at one place.
  const auto is_left = [&](std::size_t column) {
    return column == 0 || std::any_of(rows_.begin(), rows_.end(), [&](const auto& row) {
             return row[column].size() > widths[column];
           });
  };
  std::string text;
  for (const std::vector<std::string>& row : rows_) {
    std::vector<std::vector<std::string>> cells;
    std::size_t line_count = 1;
    for (const std::size_t column : columns) {
      cells.push_back(WrapText(row[column], widths[column]));
      line_count = std::max(line_count, cells.back().size());
    }
    for (std::size_t i = 0; i < line_count; ++i) {
      std::string line;
      for (std::size_t j = 0; j < columns.size(); ++j) {
        const std::string cell = i < cells[j].size() ? cells[j][i] : "";
        const std::string padding(widths[columns[j]] - cell.size(), ' ');
        line +=
            absl::StrCat(j == 0 ? "" : "  ", is_left(columns[j]) ? cell + padding : padding + cell);
      }
      line.erase(line.find_last_not_of(' ') + 1);
      text += line + "\n";
    }
  }
  return text;
}

std::string Table::ToString(int max_width) const {
  // Narrower columns would be no text any more.
  constexpr std::size_t kMinTextWidth = 16;
  const std::size_t column_count = rows_[0].size();
  std::vector<std::size_t> widths(column_count);
  std::size_t total = 2 * (column_count - 1);
  for (std::size_t column = 0; column < column_count; ++column) {
    for (const std::vector<std::string>& row : rows_) {
      widths[column] = std::max(widths[column], row[column].size());
    }
    widths[column] = std::max<std::size_t>(widths[column], 1);
    total += widths[column];
  }
  const std::size_t limit =
      max_width > 0 ? static_cast<std::size_t>(max_width) : std::max<std::size_t>(total, 1);
  while (total > limit) {
    const auto widest = std::max_element(widths.begin(), widths.end());
    if (*widest <= kMinTextWidth) {
      break;
    }
    --*widest;
    --total;
  }
  std::string text;
  for (std::size_t begin = 1; begin < column_count || begin == 1;) {
    std::size_t width = widths[0];
    std::size_t end = begin;
    while (end < column_count && (end == begin || width + 2 + widths[end] <= limit)) {
      width += 2 + widths[end++];
    }
    absl::StrAppend(&text, text.empty() ? "" : "\n", Part(begin, end, widths));
    begin = std::max(end, begin + 1);
  }
  return text;
}

std::string FormatProgress(absl::string_view phase, std::int64_t done_bytes,
                           std::int64_t total_bytes, absl::Duration elapsed) {
  const double fraction =
      std::clamp(static_cast<double>(done_bytes) / static_cast<double>(total_bytes), 0.0, 1.0);
  std::string done = FormatMebibytes(done_bytes);
  done.erase(done.size() - 4);  // the unit stands behind the total
  std::string text =
      absl::StrFormat("%-16s %3d %%  %s of %s", phase, static_cast<int>(std::floor(fraction * 100)),
                      done, FormatMebibytes(total_bytes));
  const double seconds = absl::ToDoubleSeconds(elapsed);
  if (seconds > 0 && done_bytes > 0) {
    absl::StrAppend(
        &text, "  ",
        FormatMebibytes(static_cast<std::int64_t>(static_cast<double>(done_bytes) / seconds)),
        "/s  ", FormatElapsed(elapsed * ((1 - fraction) / fraction)), " left");
  }
  return text;
}

ProgressLine::ProgressLine(std::ostream* err, bool is_terminal)
    : err_(err), is_terminal_(is_terminal), start_(absl::Now()), last_draw_(start_) {}

ProgressLine::~ProgressLine() {
  if (is_drawn_ && is_terminal_) {
    *err_ << "\r\x1b[K" << std::flush;
  }
}

bool ProgressLine::IsDue() {
  const absl::Time now = absl::Now();
  const absl::Duration interval = is_terminal_ ? absl::Milliseconds(100) : absl::Seconds(10);
  if (now - last_draw_ < interval) {
    return false;
  }
  last_draw_ = now;
  return true;
}

void ProgressLine::Draw(const std::string& any_text) {
  const std::string text = base::Printable(any_text);
  if (is_terminal_) {
    *err_ << "\r" << text << "\x1b[K" << std::flush;
  } else {
    *err_ << text << std::endl;
  }
  is_drawn_ = true;
}

void ProgressLine::Update(absl::string_view phase, std::int64_t done_bytes,
                          std::int64_t total_bytes) {
  if (!IsDue()) {
    return;
  }
  std::string text = FormatProgress(phase, done_bytes, total_bytes, absl::Now() - start_);
  if (is_terminal_) {
    const auto filled = static_cast<std::size_t>(
        std::clamp(static_cast<double>(done_bytes) / static_cast<double>(total_bytes) * kBarWidth,
                   0.0, static_cast<double>(kBarWidth)));
    text = absl::StrCat("[", std::string(filled, '#'), std::string(kBarWidth - filled, '.'), "] ",
                        text);
  }
  Draw(text);
}

void ProgressLine::Update(absl::string_view text) {
  if (IsDue()) {
    Draw(absl::StrCat(text));
  }
}

AtomicFile::AtomicFile(const std::string& path)
    : path_(path), partial_path_(IsSpecialFile(path) ? "" : PartialName(path)) {}

absl::StatusOr<std::unique_ptr<AtomicFile>> AtomicFile::Create(const std::string& path) {
  std::unique_ptr<AtomicFile> made(new AtomicFile(path));
  if (made->partial_path_.empty()) {
    made->special_ = std::make_unique<std::ofstream>(path, std::ios::binary);
    return made;
  }
  ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(made->partial_path_));
  ISOSCOPE_ASSIGN_OR_RETURN(made->file_, io::CreateWritableFile(made->partial_path_));
  return made;
}

AtomicFile::~AtomicFile() {
  if (!is_committed_ && !partial_path_.empty()) {
    file_.reset();
    io::RemoveRecursively(partial_path_).IgnoreError();
  }
}

absl::Status AtomicFile::Append(absl::string_view bytes) {
  size_bytes_ += static_cast<std::int64_t>(bytes.size());
  if (file_ != nullptr) {
    return file_->Append(bytes);
  }
  special_->write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  return special_->good() ? absl::OkStatus()
                          : absl::DataLossError(absl::StrCat("can't write to '", path_, "'"));
}

absl::Status AtomicFile::Commit() {
  if (file_ == nullptr) {
    special_->close();
    return special_->good() ? absl::OkStatus()
                            : absl::DataLossError(absl::StrCat("can't write to '", path_, "'"));
  }
  ISOSCOPE_RETURN_IF_ERROR(file_->Close());
  ISOSCOPE_RETURN_IF_ERROR(io::RenamePath(partial_path_, path_));
  is_committed_ = true;
  return absl::OkStatus();
}

std::string PartialName(const std::string& path) {
  return absl::StrCat(path, ".partial-", getpid());
}

absl::Status CheckSuffix(const std::string& path, absl::string_view suffix,
                         absl::string_view format) {
  const std::filesystem::path name(path);
  const std::string actual = name.extension().string();
  if (actual.empty() || absl::EqualsIgnoreCase(actual, suffix) || IsSpecialFile(path)) {
    return absl::OkStatus();
  }
  return UsageError(absl::StrCat("--output '", path, "': the suffix '", actual,
                                 "' is not that of the format written, ", format, "; expected '",
                                 name.stem().string(), suffix, "'"));
}

absl::Status CheckWritable(const std::string& path) {
  if (IsSpecialFile(path)) {
    return absl::OkStatus();
  }
  if (io::IsDirectory(path)) {
    return absl::FailedPreconditionError(
        absl::StrCat("'", path, "' is a folder; the name of a file is expected"));
  }
  const std::string partial = PartialName(path);
  ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(partial));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::WritableFile> file,
                            io::CreateWritableFile(partial));
  return io::RemoveRecursively(partial);
}

absl::Status WriteFileAtomically(const std::string& path, absl::string_view bytes) {
  if (IsSpecialFile(path)) {
    std::ofstream out(path, std::ios::binary);
    out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    out.close();
    return out.good() ? absl::OkStatus()
                      : absl::DataLossError(absl::StrCat("can't write to '", path, "'"));
  }
  const std::string partial = PartialName(path);
  absl::Status status = io::RemoveRecursively(partial);
  if (status.ok()) {
    status = io::WriteWholeFile(partial, bytes);
  }
  if (status.ok()) {
    status = io::RenamePath(partial, path);
  }
  if (!status.ok()) {
    // The first error is the one to report.
    io::RemoveRecursively(partial).IgnoreError();
  }
  return status;
}

}  // namespace isoscope::cli
