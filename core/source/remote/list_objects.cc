#include "core/source/remote/list_objects.h"

#include <expat.h>

#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <set>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/strip.h"

#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/source/bytes/object_key.h"
#include "core/source/bytes/percent_code.h"
#include "core/source/remote/fetch.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kMaxPageBytes = 16 * static_cast<std::size_t>(base::kMiB);
constexpr int kMaxFolderDepth = 32;
constexpr std::size_t kMaxListedTextBytes = 8192;  // of a key, encoded, or a token

class PageSink : public FetchSink {
 public:
  absl::Status Begin(std::int64_t /*size*/) override {
    bytes_.clear();
    return absl::OkStatus();
  }
  absl::Status Append(absl::string_view bytes) override {
    if (bytes_.size() + bytes.size() > kMaxPageBytes) {
      return absl::ResourceExhaustedError(
          absl::StrCat("a list of more than ", kMaxPageBytes, " bytes"));
    }
    bytes_.append(bytes.data(), bytes.size());
    return absl::OkStatus();
  }
  [[nodiscard]] const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_;
};

// Not set if a '%' begins no %XX.
std::optional<std::string> DecodeListed(absl::string_view text) {
  return IsPercentEncoded(text) ? std::optional(PercentDecode(text)) : std::nullopt;
}

// ---- S3. ----------------------------------------------------------------------------------------

// What expat tells of a list.
struct ListReader {
  XML_Parser parser = nullptr;
  ListedPage page;
  std::string text;  // of the tag that is open
  bool has_root = false;
  bool is_truncated = false;
  bool is_encoded = false;  // keys are percent-encoded, as the list says
  std::string next;
  ListedObject object;
  bool is_in_contents = false;
  std::string fault;

  void Stop(std::string why) {
    fault = std::move(why);
    XML_StopParser(parser, XML_FALSE);
  }
};

void StartListTag(void* data, const XML_Char* name, const XML_Char** /*attributes*/) {
  auto* const reader = static_cast<ListReader*>(data);
  reader->text.clear();
  const absl::string_view tag = name;
  if (!reader->has_root) {
    reader->has_root = true;
    if (tag != "ListBucketResult") {
      reader->Stop(absl::StrCat("<", base::PrintableAscii(tag.substr(0, 40)), ">"));
    }
  } else if (tag == "Contents") {
    reader->is_in_contents = true;
    reader->object = {};
  }
}

void TakeListText(void* data, const XML_Char* text, int size) {
  auto* const reader = static_cast<ListReader*>(data);
  reader->text.append(text, static_cast<std::size_t>(size));
  if (reader->text.size() > kMaxListedTextBytes) {
    reader->Stop("a text that is too long");
  }
}

void EndListTag(void* data, const XML_Char* name) {
  auto* const reader = static_cast<ListReader*>(data);
  const absl::string_view tag = name;
  const std::string text = std::exchange(reader->text, "");
  if (tag == "Contents") {
    reader->is_in_contents = false;
    reader->page.objects.push_back(std::move(reader->object));
  } else if (reader->is_in_contents && tag == "Key") {
    reader->object.key = text;
  } else if (reader->is_in_contents && tag == "Size") {
    if (!absl::SimpleAtoi(text, &reader->object.size) || reader->object.size < 0) {
      reader->Stop("a size that is no number");
    }
  } else if (!reader->is_in_contents && tag == "EncodingType") {
    reader->is_encoded = absl::StripAsciiWhitespace(text) == "url";
  } else if (tag == "IsTruncated") {
    reader->is_truncated = absl::StripAsciiWhitespace(text) == "true";
  } else if (tag == "NextContinuationToken") {
    reader->next = text;
  }
}

void RefuseDoctype(void* data, const XML_Char* /*name*/, const XML_Char* /*system*/,
                   const XML_Char* /*public_id*/, int /*has_subset*/) {
  static_cast<ListReader*>(data)->Stop("a DOCTYPE");
}

// Decodes the keys of a list that says that they are encoded; some servers do not heed encoding-type.
absl::Status DecodeKeys(ListReader* reader) {
  for (ListedObject& object : reader->page.objects) {
    std::optional<std::string> key =
        reader->is_encoded ? DecodeListed(absl::StrReplaceAll(object.key, {{"+", " "}}))
                           : std::move(object.key);
    if (!key.has_value()) {
      return absl::InvalidArgumentError(
          "what the server sends is no list of S3: a key that is not percent-encoded");
    }
    object.key = *std::move(key);
  }
  return absl::OkStatus();
}

struct FreeParser {
  void operator()(XML_Parser parser) const { XML_ParserFree(parser); }
};

absl::StatusOr<std::vector<ListedObject>> ListBucket(RemoteClient* client, const Address& folder,
                                                     const base::Cancellation& cancellation) {
  const std::string prefix =
      folder.key.empty() || absl::EndsWith(folder.key, "/") ? folder.key : folder.key + "/";
  std::vector<ListedObject> objects;
  std::string token;
  do {
    PageSink sink;
    FetchJob job{.address = {.is_s3 = true, .bucket = folder.bucket},
                 .query = {{"list-type", "2"}, {"encoding-type", "url"}, {"prefix", prefix}},
                 .sink = &sink};
    if (!token.empty()) {
      job.query.emplace_back("continuation-token", token);
    }
    ISOSCOPE_RETURN_IF_ERROR(
        Fetch(client, absl::MakeSpan(&job, 1), /*stops_at_error=*/true, cancellation));
    absl::StatusOr<ListedPage> page = ParseS3List(sink.bytes());
    if (!page.ok()) {
      return absl::InvalidArgumentError(
          absl::StrCat(NameOf(folder), ": ", page.status().message()));
    }
    if (!page->next.empty() && page->next == token) {
      return absl::InvalidArgumentError(
          absl::StrCat(NameOf(folder), ": the server gives the same page of the list again"));
    }
    token = page->next;
    for (ListedObject& object : page->objects) {
      if (!absl::StartsWith(object.key, prefix)) {
        return absl::InvalidArgumentError(absl::StrCat(NameOf(folder), ": the server lists ",
                                                       base::Quoted(object.key),
                                                       ", which is not below it"));
      }
      object.key.erase(0, prefix.size());
      if (object.key.empty() || absl::EndsWith(object.key, "/")) {
        continue;  // marks of folders
      }
      objects.push_back(std::move(object));
    }
    if (objects.size() > kMaxListedObjects) {
      return absl::ResourceExhaustedError(absl::StrCat(
          NameOf(folder), ": more than ", kMaxListedObjects, " objects; copy parts of it"));
    }
  } while (!token.empty());
  return objects;
}

// ---- Pages of an index. -------------------------------------------------------------------------

// Servers leave names out that begin with '.': the metadata of Zarr 2. Adds those that are there, and
// that `names` does not have. Returns true if the folder is a group.
absl::StatusOr<bool> AddHiddenNames(RemoteClient* client, const Address& folder,
                                    const base::Cancellation& cancellation,
                                    std::vector<std::string>* names) {
  constexpr std::array<const char*, 4> kHidden = {".zgroup", ".zarray", ".zattrs", ".zmetadata"};
  std::array<PageSink, kHidden.size()> sinks;
  std::vector<std::string> hidden;
  std::vector<FetchJob> jobs;
  for (const char* const name : kHidden) {
    if (std::find(names->begin(), names->end(), name) == names->end()) {
      jobs.push_back({.address = AddressBelow(folder, name), .sink = &sinks[hidden.size()]});
      hidden.emplace_back(name);
    }
  }
  Fetch(client, absl::MakeSpan(jobs), /*stops_at_error=*/false, cancellation).IgnoreError();
  for (std::size_t i = 0; i < jobs.size(); ++i) {
    if (jobs[i].status.ok()) {
      // Some servers have a page for every name.
      if (absl::StartsWith(absl::StripLeadingAsciiWhitespace(sinks[i].bytes()), "{")) {
        names->push_back(hidden[i]);
      }
    } else if (!absl::IsNotFound(jobs[i].status) && !absl::IsPermissionDenied(jobs[i].status)) {
      return jobs[i].status;
    }
  }
  return std::find(names->begin(), names->end(), ".zgroup") != names->end();
}

// `may_be_zarr`: the folder may have hidden metadata.
absl::Status ListPage(RemoteClient* client, const Address& top, const Address& folder,
                      const std::string& below, int depth, bool may_be_zarr,
                      const base::Cancellation& cancellation, std::vector<ListedObject>* objects) {
  if (depth > kMaxFolderDepth) {
    return absl::ResourceExhaustedError(absl::StrCat(NameOf(folder), ": folders more than ",
                                                     kMaxFolderDepth, " deep below ", NameOf(top)));
  }
  PageSink sink;
  FetchJob job{.address = folder, .sink = &sink};
  ISOSCOPE_RETURN_IF_ERROR(
      Fetch(client, absl::MakeSpan(&job, 1), /*stops_at_error=*/true, cancellation));
  std::vector<std::string> names = NamesOfIndex(sink.bytes(), folder.path);
  bool is_group = false;
  if (may_be_zarr && !names.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(is_group, AddHiddenNames(client, folder, cancellation, &names));
  }
  for (const std::string& name : names) {
    const bool is_folder = absl::EndsWith(name, "/");
    const std::string key = absl::StrCat(below, absl::StripSuffix(name, "/"));
    ISOSCOPE_RETURN_IF_ERROR(CheckObjectKey(key));
    if (!is_folder) {
      objects->push_back({.key = key});
    } else {
      Address next = AddressBelow(folder, absl::StripSuffix(name, "/"));
      next.path.push_back('/');
      ISOSCOPE_RETURN_IF_ERROR(ListPage(client, top, next, absl::StrCat(key, "/"), depth + 1,
                                        is_group || absl::EndsWith(key, ".zarr"), cancellation,
                                        objects));
    }
    if (objects->size() > kMaxListedObjects) {
      return absl::ResourceExhaustedError(absl::StrCat(
          NameOf(top), ": more than ", kMaxListedObjects, " objects; copy parts of it"));
    }
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<ListedPage> ParseS3List(absl::string_view xml) {
  const std::unique_ptr<XML_ParserStruct, FreeParser> parser(XML_ParserCreate("UTF-8"));
  if (parser == nullptr) {
    return absl::ResourceExhaustedError("no memory to read a list of S3");
  }
  ListReader reader;
  reader.parser = parser.get();
  XML_SetUserData(parser.get(), &reader);
  XML_SetElementHandler(parser.get(), StartListTag, EndListTag);
  XML_SetCharacterDataHandler(parser.get(), TakeListText);
  XML_SetStartDoctypeDeclHandler(parser.get(), RefuseDoctype);
  const bool is_parsed =
      xml.size() <= kMaxPageBytes &&
      XML_Parse(parser.get(), xml.data(), static_cast<int>(xml.size()), XML_TRUE) == XML_STATUS_OK;
  if (!is_parsed || !reader.fault.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(
        "what the server sends is no list of S3: ",
        reader.fault.empty() ? XML_ErrorString(XML_GetErrorCode(parser.get())) : reader.fault));
  }
  ISOSCOPE_RETURN_IF_ERROR(DecodeKeys(&reader));
  if (reader.is_truncated) {
    if (reader.next.empty()) {
      return absl::InvalidArgumentError("the server cuts its list, and gives no token to go on");
    }
    reader.page.next = std::move(reader.next);
  }
  return std::move(reader.page);
}

std::vector<std::string> NamesOfIndex(absl::string_view html, absl::string_view path) {
  std::vector<std::string> names;
  std::set<std::string> seen;
  const std::string lower = absl::AsciiStrToLower(html);
  for (std::size_t at = lower.find("href="); at != std::string::npos;
       at = lower.find("href=", at + 1)) {
    // 1. The link.
    const std::size_t begin = at + 6;
    if (begin >= html.size() || (html[begin - 1] != '"' && html[begin - 1] != '\'')) {
      continue;
    }
    const std::size_t end = html.find(html[begin - 1], begin);
    if (end == absl::string_view::npos) {
      break;
    }
    const std::string link = absl::StrReplaceAll(html.substr(begin, end - begin), {{"&amp;", "&"},
                                                                                   {"&quot;", "\""},
                                                                                   {"&#39;", "'"},
                                                                                   {"&#x27;", "'"},
                                                                                   {"&lt;", "<"},
                                                                                   {"&gt;", ">"}});
    // 2. One level below.
    absl::string_view rest = link;
    if (absl::StartsWith(rest, "/") && !absl::ConsumePrefix(&rest, path)) {
      continue;
    }
    absl::ConsumePrefix(&rest, "./");
    if (rest.empty() || rest.find_first_of("?#:") != absl::string_view::npos) {
      continue;  // sorting, anchors, other addresses
    }
    std::optional<std::string> name = DecodeListed(rest);
    if (!name.has_value()) {
      continue;
    }
    const std::string plain(absl::StripSuffix(*name, "/"));
    if (plain.find('/') != std::string::npos || !CheckObjectKey(plain).ok() ||
        !seen.insert(*name).second) {
      continue;
    }
    names.push_back(*std::move(name));
  }
  return names;
}

absl::StatusOr<std::vector<ListedObject>> ListObjects(RemoteClient* client, const Address& folder,
                                                      const base::Cancellation& cancellation) {
  std::vector<ListedObject> objects;
  if (folder.is_s3) {
    ISOSCOPE_ASSIGN_OR_RETURN(objects, ListBucket(client, folder, cancellation));
  } else {
    Address top = folder;
    if (!absl::EndsWith(top.path, "/")) {
      top.path.push_back('/');
    }
    ISOSCOPE_RETURN_IF_ERROR(
        ListPage(client, top, top, "", 0, /*may_be_zarr=*/true, cancellation, &objects));
  }
  for (const ListedObject& object : objects) {
    const absl::Status valid = CheckObjectKey(object.key);
    if (!valid.ok()) {
      return absl::Status(valid.code(), absl::StrCat(NameOf(folder), ": ", valid.message()));
    }
  }
  std::sort(objects.begin(), objects.end(),
            [](const ListedObject& a, const ListedObject& b) { return a.key < b.key; });
  if (objects.empty()) {
    return absl::NotFoundError(absl::StrCat(
        NameOf(folder), ": nothing is below it",
        folder.is_s3 ? "" : ", or the server gives no index of it: its page links to no file"));
  }
  return objects;
}

}  // namespace isoscope::source
