#include "core/source/bytes/xml_tags.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "expat.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxXmlBytes = 64 * base::kMiB;
constexpr std::int64_t kMaxXmlTagBytes = base::kMiB;
constexpr std::size_t kMaxXmlDepth = 64;

class TagParser {
 public:
  explicit TagParser(const std::function<absl::Status(const XmlTag&)>& visit)
      : parser_(XML_ParserCreate(nullptr)), visit_(visit) {
    ISOSCOPE_CHECK(parser_ != nullptr);
    XML_SetUserData(parser_, this);
    XML_SetElementHandler(parser_, &TagParser::OnStart, &TagParser::OnEnd);
    XML_SetStartDoctypeDeclHandler(parser_, &TagParser::OnDoctype);
  }
  ~TagParser() { XML_ParserFree(parser_); }
  TagParser(const TagParser&) = delete;
  TagParser& operator=(const TagParser&) = delete;

  // `read` copies bytes from an offset on.
  absl::Status Parse(std::int64_t size_bytes, const std::string& name, const std::string& what,
                     const std::function<absl::Status(std::int64_t, std::size_t, char*)>& read) {
    if (size_bytes > kMaxXmlBytes) {
      return absl::InvalidArgumentError(absl::StrFormat("%s: %d bytes; a %s has at most %d", name,
                                                        size_bytes, what, kMaxXmlBytes));
    }
    std::string buffer(static_cast<std::size_t>(64 * base::kKiB), '\0');
    std::int64_t offset = 0;
    do {
      const auto size = static_cast<std::size_t>(
          std::min(size_bytes - offset, static_cast<std::int64_t>(buffer.size())));
      ISOSCOPE_RETURN_IF_ERROR(read(offset, size, buffer.data()));
      offset += static_cast<std::int64_t>(size);
      const bool is_last = offset == size_bytes;
      const bool is_xml = XML_Parse(parser_, buffer.data(), static_cast<int>(size),
                                    is_last ? 1 : 0) != XML_STATUS_ERROR;
      const auto line = static_cast<std::int64_t>(XML_GetCurrentLineNumber(parser_));
      if (!problem_.ok()) {
        return absl::Status(problem_.code(),
                            absl::StrFormat("%s: line %d: %s", name, line, problem_.message()));
      }
      // expat holds what it has not finished.
      if (!is_xml || offset - XML_GetCurrentByteIndex(parser_) > kMaxXmlTagBytes) {
        return absl::InvalidArgumentError(absl::StrFormat(
            "%s: line %d: %s: no %s, or it is cut", name, line,
            is_xml ? "a tag of more than a MiB" : XML_ErrorString(XML_GetErrorCode(parser_)),
            what));
      }
    } while (offset < size_bytes);
    return absl::OkStatus();
  }

 private:
  static void XMLCALL OnStart(void* self, const XML_Char* name, const XML_Char** attributes) {
    auto* const parser = static_cast<TagParser*>(self);
    XmlTag tag{.name = name,
               .parent = parser->open_.empty() ? "" : parser->open_.back(),
               .attributes = {}};
    for (; attributes[0] != nullptr; attributes += 2) {
      tag.attributes[attributes[0]] = attributes[1];
    }
    parser->problem_ = parser->open_.size() == kMaxXmlDepth
                           ? absl::InvalidArgumentError("tags too deep in each other")
                           : parser->visit_(tag);
    if (!parser->problem_.ok()) {
      XML_StopParser(parser->parser_, XML_FALSE);
    }
    parser->open_.push_back(std::move(tag.name));
  }
  static void XMLCALL OnEnd(void* self, const XML_Char* /*name*/) {
    static_cast<TagParser*>(self)->open_.pop_back();
  }

  static void XMLCALL OnDoctype(void* self, const XML_Char* /*name*/, const XML_Char* /*system*/,
                                const XML_Char* /*id*/, int /*has_subset*/) {
    auto* const parser = static_cast<TagParser*>(self);
    parser->problem_ = absl::InvalidArgumentError(
        "a DOCTYPE, which could define entities: expected a file without one");
    XML_StopParser(parser->parser_, XML_FALSE);
  }

  XML_Parser parser_;
  const std::function<absl::Status(const XmlTag&)>& visit_;
  std::vector<std::string> open_;  // names
  absl::Status problem_;
};

}  // namespace

std::string XmlTag::Get(const std::string& attribute) const {
  const auto found = attributes.find(attribute);
  return found == attributes.end() ? "" : found->second;
}

absl::Status ReadXmlTags(const std::string& path, const std::string& what,
                         const std::function<absl::Status(const XmlTag&)>& visit) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::RandomAccessFile> file,
                            io::OpenRandomAccessFile(path));
  return TagParser(visit).Parse(file->size_bytes(), file->path(), what,
                                [&](std::int64_t offset, std::size_t size, char* out) {
                                  return file->ReadAt(offset, size, out);
                                });
}

absl::Status ParseXmlTags(absl::string_view text, const std::string& name, const std::string& what,
                          const std::function<absl::Status(const XmlTag&)>& visit) {
  return TagParser(visit).Parse(static_cast<std::int64_t>(text.size()), name, what,
                                [&](std::int64_t offset, std::size_t size, char* out) {
                                  text.copy(out, size, static_cast<std::size_t>(offset));
                                  return absl::OkStatus();
                                });
}

}  // namespace isoscope::source
