#include "core/formats/zarr/zarr_store.h"

#include <algorithm>
#include <cstddef>
#include <set>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"

#include "core/base/printable.h"
#include "core/base/status_macros.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kMaxZarrChildren = 10'000;

std::string Below(const std::string& path, absl::string_view name) {
  return path.empty() ? std::string(name) : absl::StrCat(path, "/", name);
}

constexpr char kConsolidatedKey[] = ".zmetadata";
constexpr char kDocument3[] = "zarr.json";
constexpr char kArray2[] = ".zarray";
constexpr char kGroup2[] = ".zgroup";
constexpr char kAttributes2[] = ".zattrs";

std::vector<std::string> DocumentsOfAnyVersion() {
  return {kDocument3, kArray2, kGroup2, kAttributes2};
}

void AddReads(const std::string& path, const std::vector<std::string>& documents,
              std::vector<ObjectRead>* reads) {
  for (const std::string& name : documents) {
    reads->push_back({.key = Below(path, name), .max_size = kMaxZarrJsonBytes});
  }
}

bool IsZarrPath(const std::string& path) {
  if (path.empty()) {
    return true;
  }
  for (const absl::string_view part : absl::StrSplit(path, '/')) {
    if (part.empty() || part == "." || part == ".." || part.size() > 255 ||
        part.find('\0') != absl::string_view::npos) {
      return false;
    }
  }
  return true;
}

}  // namespace

ZarrStore::ZarrStore(std::shared_ptr<const ObjectStore> objects, List list)
    : objects_(std::move(objects)), list_(std::move(list)), documents_(DocumentsOfAnyVersion()) {}

void ZarrStore::ExpectRoot(const ObjectStore& objects, const std::string& path) {
  std::vector<ObjectRead> reads;
  AddReads("", DocumentsOfAnyVersion(), &reads);
  reads.push_back({.key = kConsolidatedKey, .max_size = kMaxZarrJsonBytes});
  // Groups above an array may have an image with it.
  for (std::string node = IsZarrPath(path) ? path : ""; !node.empty();
       node.resize(std::max(node.rfind('/') + 1, std::size_t{1}) - 1)) {
    AddReads(node, DocumentsOfAnyVersion(), &reads);
  }
  objects.Expect(reads);
}

absl::StatusOr<std::unique_ptr<ZarrStore>> ZarrStore::Open(
    std::shared_ptr<const ObjectStore> objects, List list) {
  std::unique_ptr<ZarrStore> store(new ZarrStore(std::move(objects), std::move(list)));
  // Together, since each takes a round trip at an address.
  absl::StatusOr<std::string> consolidated;
  ISOSCOPE_ASSIGN_OR_RETURN(Texts root, store->Read("", &consolidated));
  if (store->list_ == nullptr) {
    store->documents_ = root.v3.has_value()
                            ? std::vector<std::string>{kDocument3}
                            : std::vector<std::string>{kArray2, kGroup2, kAttributes2};
  }
  if (root.v3.has_value()) {
    store->TakeConsolidated3(*root.v3);
  } else {
    if (consolidated.ok()) {
      ISOSCOPE_ASSIGN_OR_RETURN(
          const ZarrJson metadata,
          ParseZarrJson(*consolidated, absl::StrCat(store->name(), "/", kConsolidatedKey)));
      store->TakeConsolidated2(metadata);
    } else if (!absl::IsNotFound(consolidated.status())) {
      return consolidated.status();
    }
    if (!root.array.has_value() && !root.group.has_value() && store->consolidated_.empty()) {
      return absl::NotFoundError(absl::StrCat(
          store->name(), ": no Zarr store: neither zarr.json nor .zgroup, .zarray or .zmetadata"));
    }
  }
  store->consolidated_[""] = std::move(root);
  return store;
}

std::string ZarrStore::NameOf(const std::string& path) const {
  return path.empty() ? name() : absl::StrCat(name(), ":", base::Printable(path));
}

void ZarrStore::TakeConsolidated2(const ZarrJson& metadata) {
  const ZarrJson* const nodes = MemberOf(metadata, "metadata");
  if (nodes == nullptr || !nodes->is_object()) {
    return;
  }
  for (const auto& item : nodes->items()) {
    const std::size_t slash = item.key().rfind('/');
    const std::string path = slash == std::string::npos ? "" : item.key().substr(0, slash);
    const std::string file = slash == std::string::npos ? item.key() : item.key().substr(slash + 1);
    if (!item.value().is_object()) {
      continue;
    }
    Texts& texts = consolidated_[path];
    if (file == ".zarray") {
      texts.array = item.value();
    } else if (file == ".zgroup") {
      texts.group = item.value();
    } else if (file == ".zattrs") {
      texts.attributes = item.value();
    }
  }
}

void ZarrStore::TakeConsolidated3(const ZarrJson& root) {
  const ZarrJson* const consolidated = MemberOf(root, "consolidated_metadata");
  const ZarrJson* const nodes =
      consolidated == nullptr ? nullptr : MemberOf(*consolidated, "metadata");
  if (nodes == nullptr || !nodes->is_object()) {
    return;
  }
  for (const auto& item : nodes->items()) {
    if (item.value().is_object()) {
      consolidated_[item.key()].v3 = item.value();
    }
  }
}

absl::StatusOr<ZarrStore::Texts> ZarrStore::Read(const std::string& path,
                                                 absl::StatusOr<std::string>* consolidated) {
  std::vector<ObjectRead> reads;
  AddReads(path, documents_, &reads);
  if (consolidated != nullptr) {
    reads.push_back({.key = kConsolidatedKey, .max_size = kMaxZarrJsonBytes});
  }
  Texts texts;
  const std::map<std::string, std::optional<ZarrJson>*> places = {
      {kDocument3, &texts.v3},
      {kArray2, &texts.array},
      {kGroup2, &texts.group},
      {kAttributes2, &texts.attributes}};
  auto objects = objects_->Read(reads, base::Cancellation());
  if (consolidated != nullptr) {
    *consolidated = std::move(objects.back());
  }
  for (std::size_t i = 0; i < documents_.size(); ++i) {
    if (absl::IsNotFound(objects[i].status())) {
      continue;
    }
    ISOSCOPE_RETURN_IF_ERROR(objects[i].status());
    ISOSCOPE_ASSIGN_OR_RETURN(*places.at(documents_[i]),
                              ParseZarrJson(*objects[i], absl::StrCat(name(), "/", reads[i].key)));
    if (texts.v3.has_value()) {
      break;  // files of Zarr 2 beside it do not count
    }
  }
  return texts;
}

bool ZarrStore::IsKnown(const std::string& path) const {
  const auto known = consolidated_.find(path);
  return known != consolidated_.end() &&
         (known->second.v3.has_value() || known->second.array.has_value() ||
          known->second.group.has_value());
}

void ZarrStore::Expect(const std::set<std::string>& paths) const {
  std::vector<ObjectRead> reads;
  for (const std::string& path : paths) {
    if (IsZarrPath(path) && !IsKnown(path)) {
      AddReads(path, documents_, &reads);
    }
  }
  objects_->Expect(reads);
}

absl::StatusOr<ZarrNode> ZarrStore::Node(const std::string& path) {
  if (!IsZarrPath(path)) {
    return absl::InvalidArgumentError(absl::StrCat(name(), ": \"", base::Printable(path),
                                                   "\" is no path of a group or an array"));
  }
  Texts texts;
  if (IsKnown(path)) {
    texts = consolidated_.at(path);
  } else {
    ISOSCOPE_ASSIGN_OR_RETURN(texts, Read(path));
  }
  ZarrNode node{.path = path};
  if (texts.v3.has_value()) {
    const std::string type = TextOf(*texts.v3, "node_type");
    if (type != "array" && type != "group") {
      return absl::InvalidArgumentError(absl::StrCat(NameOf(path), ": its node_type is \"",
                                                     base::Printable(base::CutText(type, 40)),
                                                     "\"; expected \"array\" or \"group\""));
    }
    node.is_array = type == "array";
    if (const ZarrJson* const attributes = MemberOf(*texts.v3, "attributes");
        attributes != nullptr && attributes->is_object()) {
      node.attributes = *attributes;
    }
    if (node.is_array) {
      node.array = ParseZarr3Array(*texts.v3, path, NameOf(path));
    }
    return node;
  }
  node.is_array = texts.array.has_value();
  node.attributes = texts.attributes.value_or(ZarrJson::object());
  if (node.is_array) {
    node.array = ParseZarr2Array(*texts.array, node.attributes, path, NameOf(path));
  } else if (!texts.group.has_value() && !path.empty()) {
    return absl::NotFoundError(
        absl::StrCat(name(), ": no group or array \"", base::Printable(path), "\" in it"));
  }
  return node;
}

absl::StatusOr<std::vector<std::string>> ZarrStore::Children(const std::string& path) {
  std::set<std::string> children;
  const std::string prefix = path.empty() ? "" : absl::StrCat(path, "/");
  for (const auto& [known, texts] : consolidated_) {
    if (known.size() > prefix.size() && absl::StartsWith(known, prefix) &&
        children.size() < kMaxZarrChildren) {
      children.insert(known.substr(0, known.find('/', prefix.size())));
    }
  }
  if (children.empty() && list_ != nullptr) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> names, list_(path));
    for (const std::string& name : names) {
      if (children.size() < kMaxZarrChildren) {
        children.insert(Below(path, name));
      }
    }
  }
  return std::vector<std::string>(children.begin(), children.end());
}

}  // namespace isoscope::source
