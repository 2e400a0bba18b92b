// isoscope cache list, isoscope cache clear [NAME...]
//
// The cache is a folder with an entry for each partitioned volume (session/cache_entry.h).
//
// `clear` first removes work folders that ended processes have left. Then it finds the entry of
// each NAME, which is the name of an entry or the path of its source. An unknown NAME is an error
// before any entry goes. Entries in use stay, and are an error at the end.

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/time/time.h"
#include <nlohmann/json.hpp>

#include "client-cli/commands/program.h"
#include "client-cli/session/cache_entry.h"
#include "client-cli/session/dataset_cache.h"
#include "client-cli/session/session.h"
#include "clients/cpp/request/json_text.h"
#include "core/base/status_macros.h"
#include "core/cli/format.h"
#include "core/cli/table.h"
#include "core/io/work_folder.h"
#include "core/source/source_stamps.h"

namespace isoscope::cli {
namespace {

using Json = nlohmann::ordered_json;

struct ListFlags {
  std::optional<std::int64_t> limit_bytes;
  bool is_json = false;
};

std::string ToJson(const std::string& folder, std::int64_t limit_bytes,
                   const std::vector<CacheEntry>& entries) {
  Json json;
  json["folder"] = folder;
  json["limit_bytes"] = limit_bytes;
  json["total_bytes"] = TotalBytes(entries);
  json["entries"] = Json::array();
  for (const CacheEntry& entry : entries) {
    json["entries"].push_back(
        {{"name", entry.name},
         {"source", entry.source},
         {"size_bytes", entry.size_bytes},
         {"last_used", absl::FormatTime(absl::RFC3339_full, entry.last_used, absl::UTCTimeZone())},
         {"is_in_use", entry.is_in_use},
         {"is_damaged", entry.is_damaged}});
  }
  return client::JsonText(json);
}

std::string ToText(const std::string& folder, std::int64_t limit_bytes,
                   const std::vector<CacheEntry>& entries, int max_width) {
  std::string text;
  if (!entries.empty()) {
    Table table({"source", "name", "size", "last used", ""});
    for (const CacheEntry& entry : entries) {
      table.AddRow({entry.source, entry.name, FormatMebibytes(entry.size_bytes),
                    absl::FormatTime("%Y-%m-%d %H:%M", entry.last_used, absl::LocalTimeZone()),
                    entry.is_damaged ? "damaged" : (entry.is_in_use ? "in use" : "")});
    }
    text = table.ToString(max_width) + "\n";
  }
  absl::StrAppend(&text, folder, ": ", FormatCount(static_cast<std::int64_t>(entries.size())),
                  entries.size() == 1 ? " volume, " : " volumes, ",
                  FormatMebibytes(TotalBytes(entries)), " of at most ",
                  FormatMebibytes(limit_bytes), "\n");
  return text;
}

absl::Status RunList(const ListFlags& flags, const Context& context) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string folder, CacheDirectory(context.err));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t limit_bytes,
                            CacheLimitBytes(flags.limit_bytes, folder));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<CacheEntry> entries, ListEntries(folder));
  *context.out << (flags.is_json ? ToJson(folder, limit_bytes, entries)
                                 : ToText(folder, limit_bytes, entries, context.out_columns));
  return absl::OkStatus();
}

// Returns the entries that `names` select, each by its own name or by the path of a source volume.
// Without names it returns all. NOT_FOUND names the first one that selects none.
absl::StatusOr<std::vector<CacheEntry>> SelectEntries(const std::vector<std::string>& names,
                                                      const std::string& folder) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<CacheEntry> entries, ListEntries(folder));
  if (names.empty()) {
    return entries;
  }
  std::vector<bool> is_selected(entries.size());
  for (const std::string& name : names) {
    const std::string path = source::ResolvedPath(name).value_or(name);
    bool is_known = false;
    for (std::size_t i = 0; i < entries.size(); ++i) {
      if (entries[i].name == name || entries[i].source == path) {
        is_selected[i] = true;
        is_known = true;
      }
    }
    if (!is_known) {
      return absl::NotFoundError(absl::StrCat("the cache, ", folder, ", has no volume '", name,
                                              "'; 'isoscope cache list' names those it has"));
    }
  }
  std::vector<CacheEntry> selected;
  for (std::size_t i = 0; i < entries.size(); ++i) {
    if (is_selected[i]) {
      selected.push_back(entries[i]);
    }
  }
  return selected;
}

absl::Status RunClear(const std::vector<std::string>& names, const Context& context) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string folder, CacheDirectory(context.err));
  io::RemoveLeftovers(folder, kWorkPrefix);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<CacheEntry> entries, SelectEntries(names, folder));
  std::int64_t freed_bytes = 0;
  std::vector<std::string> in_use;
  for (const CacheEntry& entry : entries) {
    ISOSCOPE_ASSIGN_OR_RETURN(const bool is_gone, RemoveEntry(folder, entry.name));
    if (!is_gone) {
      in_use.push_back(entry.name);
      continue;
    }
    freed_bytes += entry.size_bytes;
    *context.out << "removed " << entry.name << ", " << FormatMebibytes(entry.size_bytes)
                 << (entry.source.empty() ? "" : ", made of " + entry.source) << "\n";
  }
  *context.out << folder << ": " << FormatMebibytes(freed_bytes) << " freed\n";
  if (!in_use.empty()) {
    return absl::FailedPreconditionError(
        absl::StrCat("still in use by another process, and kept: ", absl::StrJoin(in_use, ", ")));
  }
  return absl::OkStatus();
}

Action RegisterListFlags(FlagSet* set) {
  const auto flags = std::make_shared<ListFlags>();
  AddCacheLimitFlag(set, &flags->limit_bytes);
  set->AddSwitch("--json", &flags->is_json, "print JSON instead of text");
  return [flags](const Context& context) { return RunList(*flags, context); };
}

Action RegisterClearFlags(FlagSet* set) {
  const auto names = std::make_shared<std::vector<std::string>>();
  // Not AddListFlag, which splits values at commas: paths may contain commas.
  set->AddTexts("name", "NAME", names.get(),
                "names as 'isoscope cache list' has them, or paths of volumes (default: all)");
  return [names](const Context& context) { return RunClear(*names, context); };
}

}  // namespace

Command CacheListCommand() {
  return {.name = "cache list",
          .summary = "Lists the volumes that 'render' and 'export' have partitioned and kept",
          .usage = "[--json]",
          .examples =
              "  isoscope cache list\n"
              "\nThe cache is $XDG_CACHE_HOME/isoscope, else ~/.cache/isoscope. Volumes that have\n"
              "not been used for longest leave it when a new one would exceed its limit.\n",
          .register_flags = RegisterListFlags};
}

Command CacheClearCommand() {
  return {.name = "cache clear",
          .summary = "Removes partitioned volumes from the cache, but none that is in use",
          .usage = "[NAME...]",
          .examples =
              "  isoscope cache clear                       everything\n"
              "  isoscope cache clear head.nii.gz           what was made of one file\n",
          .register_flags = RegisterClearFlags};
}

}  // namespace isoscope::cli
