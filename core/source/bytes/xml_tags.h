// The tags of a small XML file, one after the other.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_XML_TAGS_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_XML_TAGS_H_

#include <functional>
#include <map>
#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace isoscope::source {

struct XmlTag {
  std::string name;
  std::string parent;  // the name of the tag around it; "" of the first one
  std::map<std::string, std::string> attributes;

  // "" if it is absent.
  [[nodiscard]] std::string Get(const std::string& attribute) const;
};

// Calls `visit` for each tag as it starts; text passes by. Stops at the first error of `visit`, to
// which it adds the file and the line. INVALID_ARGUMENT: no XML, or cut; more than 64 MiB, a tag of
// more than a MiB, tags more than 64 deep, or a DOCTYPE, which could define entities: holds one tag
// at a time. `what` is the kind of file for messages: "VTK collection".
absl::Status ReadXmlTags(const std::string& path, const std::string& what,
                         const std::function<absl::Status(const XmlTag&)>& visit);
// The same of a text. `name` is the file that it is from, for messages.
absl::Status ParseXmlTags(absl::string_view text, const std::string& name, const std::string& what,
                          const std::function<absl::Status(const XmlTag&)>& visit);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_XML_TAGS_H_
