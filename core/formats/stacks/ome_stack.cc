// The tags that count, of the first image:
//
//   <OME>
//    <Image>
//     <Pixels DimensionOrder="XYZCT" SizeX="64" SizeY="64" SizeZ="10" SizeC="2" SizeT="3"
//             PhysicalSizeX="0.1" PhysicalSizeXUnit="um" TimeIncrement="2" TimeIncrementUnit="s">
//      <Channel Name="GFP"/>
//      <TiffData IFD="0" FirstZ="0" FirstC="0" FirstT="0" PlaneCount="20">
//       <UUID FileName="b.ome.tif">...</UUID>
//      </TiffData>
//
// The order is written with the fastest axis first. A TiffData names PlaneCount pages from page IFD
// on, and gives them planes in that order from (FirstZ, FirstC, FirstT) on. The count is 1 if IFD
// is given, else as many as the file has. Without FileName the pages are those of the file itself.
// Each plane has one page, and each page of a file of one image one plane. The pages of further
// images are not looked at.
//
// A file that was renamed still has its old name there: if the XML names but one file, and it is
// not there, this one is meant.
//
// Source: https://docs.openmicroscopy.org/ome-model/latest/ome-tiff/specification.html.

#include "core/formats/stacks/ome_stack.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/source/bytes/xml_tags.h"

namespace isoscope::source {
namespace {

struct OmeTiffData {
  std::optional<std::int64_t> page;
  std::optional<std::int64_t> count;
  std::int64_t slice = 0;
  std::int64_t channel = 0;
  std::int64_t step = 0;
  std::string file;  // "": the file itself
};

// The name without its namespace: "Pixels" of "ome:Pixels".
absl::string_view PlainName(const std::string& name) {
  return absl::string_view(name).substr(name.rfind(':') + 1);
}

// `fallback` if the attribute is missing.
absl::StatusOr<std::int64_t> IntegerIn(const XmlTag& tag, const std::string& attribute,
                                       std::int64_t fallback, std::int64_t least) {
  const std::string text = tag.Get(attribute);
  std::int64_t number = fallback;
  if ((!text.empty() && !absl::SimpleAtoi(text, &number)) || number < least ||
      number > kMaxStackPlanes) {
    return absl::InvalidArgumentError(
        absl::StrFormat("OME-XML: %s has %s=\"%s\"; expected %d to %d", PlainName(tag.name),
                        attribute, text, least, kMaxStackPlanes));
  }
  return number;
}

// A name of another file: in the folder of this one.
absl::StatusOr<std::string> FileNameIn(const XmlTag& tag, const std::string& attribute) {
  std::string name = tag.Get(attribute);
  if (absl::StrContains(name, "/") || absl::StrContains(name, "\\") || name == "." ||
      name == "..") {
    return absl::InvalidArgumentError(absl::StrFormat(
        "OME-XML: %s names the file \"%s\"; expected a name without a folder: all files of a set "
        "lie in one",
        PlainName(tag.name), name));
  }
  return name;
}

// Takes the tags one after the other.
class OmeReader {
 public:
  absl::Status Visit(const XmlTag& tag) {
    const absl::string_view name = PlainName(tag.name);
    if (name == "BinaryOnly") {
      ISOSCOPE_ASSIGN_OR_RETURN(stack.companion, FileNameIn(tag, "MetadataFile"));
      return absl::OkStatus();
    }
    if (name == "Pixels") {
      return ++images_ == 1 ? TakePixels(tag) : absl::OkStatus();
    }
    if (images_ != 1) {
      return absl::OkStatus();
    }
    if (name == "Channel" && PlainName(tag.parent) == "Pixels") {
      stack.layout.channel_names.push_back(tag.Get("Name"));
    } else if (name == "TiffData") {
      return TakeTiffData(tag);
    } else if (name == "UUID" && PlainName(tag.parent) == "TiffData" && !data.empty()) {
      ISOSCOPE_ASSIGN_OR_RETURN(data.back().file, FileNameIn(tag, "FileName"));
    }
    return absl::OkStatus();
  }

  [[nodiscard]] int images() const { return images_; }

  OmeStack stack;
  std::string order;  // "XYZCT"
  std::vector<OmeTiffData> data;

 private:
  absl::Status TakePixels(const XmlTag& tag) {
    StackLayout& layout = stack.layout;
    ISOSCOPE_ASSIGN_OR_RETURN(stack.size_x, IntegerIn(tag, "SizeX", 0, 1));
    ISOSCOPE_ASSIGN_OR_RETURN(stack.size_y, IntegerIn(tag, "SizeY", 0, 1));
    ISOSCOPE_ASSIGN_OR_RETURN(layout.slices, IntegerIn(tag, "SizeZ", 1, 1));
    ISOSCOPE_ASSIGN_OR_RETURN(layout.channels, IntegerIn(tag, "SizeC", 1, 1));
    ISOSCOPE_ASSIGN_OR_RETURN(layout.steps, IntegerIn(tag, "SizeT", 1, 1));
    const std::int64_t in_step = layout.slices * layout.channels;
    if (in_step > kMaxStackPlanes || in_step * layout.steps > kMaxStackPlanes) {
      return absl::InvalidArgumentError(
          absl::StrFormat("OME-XML: %d slices, %d channels and %d steps; expected at most %d "
                          "planes in all",
                          layout.slices, layout.channels, layout.steps, kMaxStackPlanes));
    }
    order = tag.Get("DimensionOrder");
    std::string letters = order.substr(std::min<std::size_t>(2, order.size()));
    std::sort(letters.begin(), letters.end());
    if (!absl::StartsWith(order, "XY") || letters != "CTZ") {
      return absl::InvalidArgumentError(absl::StrFormat(
          "OME-XML: DimensionOrder=\"%s\"; expected XY, then Z, C and T in any order", order));
    }
    TakeTimes(tag);
    return TakeSpacing(tag);
  }

  void TakeTimes(const XmlTag& tag) {
    StackLayout& layout = stack.layout;
    double increment = 0;
    if (layout.steps > 1 && absl::SimpleAtod(tag.Get("TimeIncrement"), &increment) &&
        std::isfinite(increment * static_cast<double>(layout.steps)) && increment > 0) {
      for (std::int64_t i = 0; i < layout.steps; ++i) {
        layout.times.push_back(static_cast<double>(i) * increment);
      }
      layout.time_unit = tag.Get("TimeIncrementUnit");
      layout.time_unit = layout.time_unit.empty() ? "s" : layout.time_unit;
    }
  }

  absl::Status TakeSpacing(const XmlTag& tag) {
    StackLayout& layout = stack.layout;
    std::optional<LengthUnit> first;
    std::string first_text;
    std::vector<std::string> given;
    std::vector<std::string> missing;
    for (int axis = 0; axis < 3; ++axis) {
      const std::string key = absl::StrCat("PhysicalSize", std::string(1, "XYZ"[axis]));
      const std::string text = tag.Get(key);
      (text.empty() ? missing : given).push_back(key);
      if (text.empty()) {
        continue;
      }
      double size = 0;
      if (!absl::SimpleAtod(text, &size) || !std::isfinite(size) || size <= 0) {
        return absl::InvalidArgumentError(
            absl::StrFormat("OME-XML: Pixels has %s=\"%s\"; expected a length", key, text));
      }
      std::string unit_text = tag.Get(absl::StrCat(key, "Unit"));
      unit_text = unit_text.empty() ? "um" : unit_text;
      const std::optional<LengthUnit> unit = LengthUnitOf(unit_text);
      if (first_text.empty()) {
        first = unit;
        first_text = unit_text;
        const bool is_none = unit_text == "pixel" || unit_text == "reference frame";
        layout.length_unit = unit.has_value() ? unit->name : is_none ? "" : unit_text;
      } else if (unit_text != first_text && !(unit.has_value() && first.has_value())) {
        return absl::InvalidArgumentError(
            absl::StrFormat("OME-XML: sizes of pixels in \"%s\" and \"%s\"; expected one unit, or "
                            "units of length",
                            first_text, unit_text));
      } else if (unit.has_value() && first.has_value() && unit->metres != first->metres) {
        size *= unit->metres / first->metres;
      }
      layout.spacing[axis] = size;
    }
    if (!given.empty() && !missing.empty()) {
      layout.distances = absl::StrCat("OME-XML has ", absl::StrJoin(given, " and "), ", but no ",
                                      absl::StrJoin(missing, " and "));
    }
    return absl::OkStatus();
  }

  absl::Status TakeTiffData(const XmlTag& tag) {
    OmeTiffData one;
    ISOSCOPE_ASSIGN_OR_RETURN(one.slice, IntegerIn(tag, "FirstZ", 0, 0));
    ISOSCOPE_ASSIGN_OR_RETURN(one.channel, IntegerIn(tag, "FirstC", 0, 0));
    ISOSCOPE_ASSIGN_OR_RETURN(one.step, IntegerIn(tag, "FirstT", 0, 0));
    if (!tag.Get("IFD").empty()) {
      ISOSCOPE_ASSIGN_OR_RETURN(one.page, IntegerIn(tag, "IFD", 0, 0));
    }
    if (!tag.Get("PlaneCount").empty()) {
      ISOSCOPE_ASSIGN_OR_RETURN(one.count, IntegerIn(tag, "PlaneCount", 0, 0));
    }
    if (data.size() == static_cast<std::size_t>(kMaxStackPlanes)) {
      return absl::InvalidArgumentError("OME-XML: too many tags TiffData");
    }
    data.push_back(std::move(one));
    return absl::OkStatus();
  }

  int images_ = 0;
};

// Gives the planes of one TiffData their places. Returns the number of planes. INVALID_ARGUMENT,
// without the file's name: one of them has another page already.
absl::StatusOr<std::int64_t> PlaceOmePlanes(const OmeTiffData& data, const std::string& order,
                                            std::int32_t file, std::int64_t own_planes,
                                            StackLayout* layout) {
  const std::int64_t count =
      data.count.value_or(data.page.has_value() ? 1 : own_planes);  // as the file says
  std::array<std::int64_t, 3> at{data.slice, data.channel, data.step};
  const std::array<std::int64_t, 3> sizes{layout->slices, layout->channels, layout->steps};
  for (std::int64_t i = 0; i < count; ++i) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (at.at(axis) >= sizes.at(axis)) {
        return i;
      }
    }
    const auto [slice, channel, step] = at;
    StackPlane& plane = layout->planes[static_cast<std::size_t>(
        (step * layout->channels + channel) * layout->slices + slice)];
    const StackPlane named{.file = file, .index = data.page.value_or(0) + i};
    if (plane.file >= 0 && (plane.file != named.file || plane.index != named.index)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "OME-XML: its TiffData give slice %d of channel %d and step %d two pages, IFD %d and IFD "
          "%d; expected each plane once",
          slice, channel, step, plane.index, named.index));
    }
    plane = named;
    for (std::size_t letter = 2; letter < 5; ++letter) {  // the fastest axis first
      const std::size_t axis = order[letter] == 'Z' ? 0 : order[letter] == 'C' ? 1 : 2;
      if (++at.at(axis) < sizes.at(axis)) {
        break;
      }
      if (letter == 4) {
        return i + 1;
      }
      at.at(axis) = 0;
    }
  }
  return count;
}

// Checks that no page is two planes, and, if `is_only_image`, that each of the `own_planes` pages
// of the file itself, number `own_file`, is one. INVALID_ARGUMENT, without the file's name.
absl::Status CheckOmePages(const StackLayout& layout, std::int32_t own_file,
                           std::int64_t own_planes, bool is_only_image) {
  std::vector<std::size_t> order;  // of the planes with a page, by page
  for (std::size_t i = 0; i < layout.planes.size(); ++i) {
    if (layout.planes[i].file >= 0) {
      order.push_back(i);
    }
  }
  const auto page_of = [&](std::size_t i) {
    return std::pair(layout.planes[i].file, layout.planes[i].index);
  };
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return page_of(a) < page_of(b); });
  const auto twice =
      std::adjacent_find(order.begin(), order.end(),
                         [&](std::size_t a, std::size_t b) { return page_of(a) == page_of(b); });
  if (twice != order.end()) {
    const auto described = [&](std::size_t i) {
      const auto plane = static_cast<std::int64_t>(i);
      return absl::StrFormat("slice %d of channel %d and step %d", plane % layout.slices,
                             plane / layout.slices % layout.channels,
                             plane / layout.slices / layout.channels);
    };
    return absl::InvalidArgumentError(
        absl::StrFormat("OME-XML: its TiffData give %s and %s one page, IFD %d; expected a page of "
                        "its own for each plane",
                        described(std::min(twice[0], twice[1])),
                        described(std::max(twice[0], twice[1])), layout.planes[*twice].index));
  }
  const auto named = std::count_if(
      order.begin(), order.end(), [&](std::size_t i) { return layout.planes[i].file == own_file; });
  if (is_only_image && own_file >= 0 && named < own_planes) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "OME-XML: its %d slices, %d channels and %d steps take %d of the %d pages of the file; "
        "expected all pages",
        layout.slices, layout.channels, layout.steps, named, own_planes));
  }
  return absl::OkStatus();
}

}  // namespace

bool IsOmeXml(absl::string_view description) {
  constexpr std::size_t kStart = 4096;
  const absl::string_view head = description.substr(0, kStart);
  return absl::StartsWith(head, "<") &&
         (absl::StrContains(head, "<OME") || absl::StrContains(head, ":OME"));
}

absl::StatusOr<OmeStack> ParseOmeXml(absl::string_view xml, const std::string& path,
                                     const std::string& own_name, std::int64_t own_planes) {
  OmeReader reader;
  ISOSCOPE_RETURN_IF_ERROR(
      ParseXmlTags(xml, path, "OME-XML", [&](const XmlTag& tag) { return reader.Visit(tag); }));
  OmeStack stack = std::move(reader.stack);
  if (stack.size_x == 0) {
    if (stack.companion.empty()) {
      return absl::InvalidArgumentError(absl::StrCat(path, ": OME-XML without a tag Pixels"));
    }
    return stack;
  }
  stack.companion.clear();
  StackLayout& layout = stack.layout;
  layout.planes.assign(static_cast<std::size_t>(layout.slices * layout.channels * layout.steps),
                       StackPlane());
  if (reader.data.empty()) {
    reader.data.emplace_back();
  }
  const std::string folder = path.substr(0, path.rfind('/') + 1);
  const std::string& first_file = reader.data.front().file;
  const bool is_renamed =
      std::all_of(reader.data.begin(), reader.data.end(),
                  [&](const OmeTiffData& data) { return data.file == first_file; }) &&
      !first_file.empty() && !io::PathExists(folder + first_file);
  std::map<std::string, std::int32_t> files;
  std::int64_t placed = 0;
  for (const OmeTiffData& data : reader.data) {
    const std::string name = data.file.empty() || is_renamed ? own_name : data.file;
    const auto [file, is_new] = files.emplace(name, static_cast<std::int32_t>(files.size()));
    if (is_new) {
      layout.files.push_back(name);
    }
    const auto count = PlaceOmePlanes(data, reader.order, file->second,
                                      name == own_name ? own_planes : 1, &layout);
    if (!count.ok()) {
      return absl::Status(count.status().code(),
                          absl::StrCat(path, ": ", count.status().message()));
    }
    placed += *count;
    if (placed > 2 * static_cast<std::int64_t>(layout.planes.size())) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: OME-XML: its TiffData name more than twice its %d planes; expected each once", path,
          layout.planes.size()));
    }
  }
  const auto own = files.find(own_name);
  const absl::Status pages = CheckOmePages(layout, own == files.end() ? -1 : own->second,
                                           own_planes, reader.images() == 1);
  if (!pages.ok()) {
    return absl::Status(pages.code(), absl::StrCat(path, ": ", pages.message()));
  }
  return stack;
}

}  // namespace isoscope::source
