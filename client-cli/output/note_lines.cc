#include "client-cli/output/note_lines.h"

#include <algorithm>
#include <cstddef>
#include <ostream>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

#include "core/base/printable.h"

namespace isoscope::cli {
namespace {

constexpr std::size_t kMaxNoteLines = 12;

// "frame 3", "frames 2, 5 to 7": ascending numbers.
std::string TextOfFrames(const std::vector<std::size_t>& frames) {
  std::vector<std::string> parts;
  for (std::size_t begin = 0; begin < frames.size();) {
    std::size_t end = begin + 1;
    while (end < frames.size() && frames[end] == frames[end - 1] + 1) {
      ++end;
    }
    parts.push_back(end - begin == 1 ? absl::StrCat(frames[begin])
                                     : absl::StrCat(frames[begin], " to ", frames[end - 1]));
    begin = end;
  }
  return absl::StrCat(frames.size() == 1 ? "frame " : "frames ", absl::StrJoin(parts, ", "));
}

}  // namespace

std::vector<std::string> NoteLines(const std::vector<FrameRecord>& frames) {
  std::vector<std::pair<std::string, std::vector<std::size_t>>> frames_of;  // by message
  for (std::size_t i = 0; i < frames.size(); ++i) {
    for (const isoscope::v1::SurfaceNote& note : frames[i].notes) {
      const auto found = std::find_if(frames_of.begin(), frames_of.end(), [&](const auto& known) {
        return known.first == note.message();
      });
      std::vector<std::size_t>& having = found != frames_of.end()
                                             ? found->second
                                             : frames_of.emplace_back(note.message(), 0).second;
      if (having.empty() || having.back() != i) {
        having.push_back(i);
      }
    }
  }
  std::vector<std::string> lines;
  for (const auto& [message, having] : frames_of) {
    if (lines.size() + 1 == kMaxNoteLines && frames_of.size() > kMaxNoteLines) {
      lines.push_back(absl::StrCat(frames_of.size() - lines.size(),
                                   " more notes on surfaces that do not show; --stats has all"));
      break;
    }
    lines.push_back(
        absl::StrCat(having.size() == frames.size() ? "" : absl::StrCat(TextOfFrames(having), ": "),
                     base::Printable(message)));
  }
  return lines;
}

void WriteNotes(const std::vector<FrameRecord>& frames, const Context& context) {
  for (const std::string& line : NoteLines(frames)) {
    *context.err << "isoscope: " << line << std::endl;
  }
}

}  // namespace isoscope::cli
