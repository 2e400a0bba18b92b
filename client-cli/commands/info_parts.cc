#include "client-cli/commands/info_parts.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include <nlohmann/json.hpp>

#include "core/base/printable.h"
#include "core/base/shell_word.h"
#include "core/base/status_macros.h"
#include "core/cli/format.h"
#include "core/io/file.h"
#include "core/partition/part_folder.h"

namespace isoscope::cli {
namespace {

// Parts tell every few seconds how far they are; a slow disk may hold one up.
constexpr std::int64_t kSilentSeconds = 60;
constexpr std::size_t kMaxListedParts = 40;

Json PartToJson(const partition::PartState& part, int volume_count, std::int64_t now) {
  Json json;
  json["part"] = part.part.index;
  const bool is_finished = part.has_begun && part.finished_volumes >= volume_count;
  if (is_finished || part.tries.empty()) {
    json["state"] = is_finished ? "finished" : "waiting";
    json["finished_volume_count"] = part.finished_volumes;
    return json;
  }
  const store::PartProgress& last = part.tries.front();
  const std::int64_t silent = std::max<std::int64_t>(now - last.updated_unix_seconds, 0);
  json["state"] = silent < kSilentSeconds ? "running" : "silent";
  json["finished_volume_count"] = part.finished_volumes;
  json["percent"] = last.total_bytes > 0 ? 100 * static_cast<double>(last.done_bytes) /
                                               static_cast<double>(last.total_bytes)
                                         : 0.0;
  json["host"] = last.host;
  json["process_id"] = last.process_id;
  json["seconds_since_news"] = silent;
  return json;
}

std::string TextOf(const Json& part) {
  const std::string state = part.at("state").get<std::string>();
  if (state == "waiting") {
    return part.at("finished_volume_count").get<int>() > 0
               ? absl::StrCat("stopped after ", part.at("finished_volume_count").dump(), " volumes")
               : "not begun, or stopped";
  }
  std::string text = absl::StrCat(static_cast<int>(part.at("percent").get<double>()), " %, on ",
                                  part.at("host").get<std::string>(), " (process ",
                                  part.at("process_id").dump(), "), ");
  const absl::Duration silent = absl::Seconds(part.at("seconds_since_news").get<std::int64_t>());
  return absl::StrCat(text, "last news ", FormatElapsed(silent), " ago",
                      state == "silent" ? ": run it again if its process has ended" : "");
}

}  // namespace

bool HoldsParts(const std::string& path) {
  return (absl::EndsWith(path, ".partial") || absl::EndsWith(path, ".partial/") ||
          !io::PathExists(path)) &&
         partition::PartFolder(path).Exists();
}

absl::StatusOr<Json> DescribeParts(const std::string& path) {
  const partition::PartFolder folder(path);
  ISOSCOPE_ASSIGN_OR_RETURN(const partition::PartsState state, partition::ReadPartsState(folder));
  const std::int64_t now = absl::ToUnixSeconds(absl::Now());
  Json parts = Json::array();
  int finished = 0;
  for (const partition::PartState& part : state.parts) {
    parts.push_back(PartToJson(part, state.volume_count, now));
    finished += parts.back().at("state") == "finished" ? 1 : 0;
  }
  Json json;
  json["parts"] = {{"dataset", state.cut.name},          {"directory", folder.output()},
                   {"part_count", state.cut.part.count}, {"volume_count", state.volume_count},
                   {"finished_count", finished},         {"parts", std::move(parts)}};
  return json;
}

std::string PartsText(const Json& json) {
  const Json& all = json.at("parts");
  const int count = all.at("part_count").get<int>();
  const int finished = all.at("finished_count").get<int>();
  const std::string directory = all.at("directory").get<std::string>();
  std::string text;
  AddLine("dataset", base::Printable(all.at("dataset").get<std::string>()), &text);
  AddLine("parts", absl::StrCat(finished, " of ", count, " finished"), &text);
  std::size_t listed = 0;
  int next = -1;
  for (const Json& part : all.at("parts")) {
    const std::string state = part.at("state").get<std::string>();
    if (state == "finished") {
      continue;
    }
    if (next < 0 && state == "waiting") {
      next = part.at("part").get<int>();
    }
    if (listed++ < kMaxListedParts) {
      AddLine(absl::StrCat("part ", part.at("part").dump()), base::Printable(TextOf(part)), &text);
    }
  }
  if (listed > kMaxListedParts) {
    AddLine("", absl::StrCat("and ", listed - kMaxListedParts, " more that are not finished"),
            &text);
  }
  if (finished == count) {
    AddLine("next", absl::StrCat("isoscope partition --finish ", base::ShellWord(directory)),
            &text);
  } else if (next >= 0) {
    AddLine("next",
            absl::StrCat("isoscope partition SOURCE --part ", next, "/", count, " --output ",
                         base::ShellWord(directory), ", with the flags of the others"),
            &text);
  }
  return text;
}

}  // namespace isoscope::cli
