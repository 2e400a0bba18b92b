// Finding takes four steps:
//
// 1. A part of the path that ends in ".zarr" is the root of a store, and the rest is a part of it.
// 2. Else the path is a file, perhaps with a colon and a part behind it: the colon behind an ending
//    that a format has; the whole path; the last colons.
// 3. Of each, an object is looked for, and a store; a name without an ending is a store first.
// 4. What was found is kept under its name: an object as a mounted file, a store by its address.
//
// A store is read through AddressStore. It records digests of the metadata that it reads, and takes
// an answer of 403 for a missing document, as S3 gives it, once another document was read. It asks
// twice for a chunk before it takes it for missing. While an AddressOpening lives, it keeps small
// answers there, those of missing objects, too.

#include "core/formats/address_source.h"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/time/time.h"

#include "core/base/cancellation.h"
#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/process_interrupt.h"
#include "core/base/sha256.h"
#include "core/base/status_macros.h"
#include "core/formats/address_opening.h"
#include "core/formats/format_table.h"
#include "core/formats/zarr/zarr_series.h"
#include "core/io/file.h"
#include "core/io/mounted_file.h"
#include "core/source/bytes/byte_source.h"
#include "core/source/bytes/cached_bytes.h"
#include "core/source/bytes/object_store.h"
#include "core/source/bytes/part_path.h"
#include "core/source/remote/address.h"
#include "core/source/remote/open_address.h"
#include "core/source/remote/remote_options.h"
#include "core/source/volume_series.h"

namespace isoscope::source {
namespace {

// Callers ask several times for one source: an error is not waited for again.
constexpr absl::Duration kErrorLife = absl::Seconds(5);
constexpr std::size_t kMaxColons = 3;  // that may begin a part
constexpr std::size_t kMaxPaths = 10'000;
constexpr std::size_t kMaxKeptObjectBytes = std::size_t{64} << 10;  // that is no metadata

// ---- Addresses as texts. ------------------------------------------------------------------------

// The part of the address that tells the object: path or key.
const std::string& ObjectPathOf(const Address& address) {
  return address.is_s3 ? address.key : address.path;
}
Address WithObjectPath(Address address, absl::string_view path) {
  (address.is_s3 ? address.key : address.path) = std::string(path);
  return address;
}
std::string PathOfAddress(Address address) {
  address.query.clear();
  return NameOf(address);
}
// With the query: for requests alone.
std::string RequestTextOf(const Address& address) {
  return address.is_s3 ? NameOf(address) : UrlOf(address);
}

// Parameters of a signature differ each time that an address is signed.
bool IsOfSignature(absl::string_view parameter) {
  const std::string name = absl::AsciiStrToLower(parameter.substr(0, parameter.find('=')));
  return absl::StartsWith(name, "x-amz-") || absl::StartsWith(name, "x-goog-") ||
         name == "signature" || name == "expires" || name == "sig" || name == "se" || name == "st";
}

// Differs if the query may lead to another object; tells nothing of it.
std::string DigestOf(absl::string_view query) {
  std::string kept;
  for (const absl::string_view parameter : absl::StrSplit(query, '&', absl::SkipEmpty())) {
    if (!IsOfSignature(parameter)) {
      absl::StrAppend(&kept, parameter, "&");
    }
  }
  return kept.empty() ? "" : absl::StrCat(" ", base::Sha256Hex(kept).substr(0, 16));
}

// ---- Stores. ------------------------------------------------------------------------------------

// "a/b/.zarray": "a/b/" and ".zarray".
struct PathParts {
  absl::string_view folder;
  absl::string_view name;
};
PathParts PartsOf(absl::string_view key) {
  const std::size_t end = key.rfind('/') + 1;  // 0 where there is none
  return {.folder = key.substr(0, end), .name = key.substr(end)};
}

bool IsZarrDocument(absl::string_view key) {
  const absl::string_view name = PartsOf(key).name;
  return name == "zarr.json" || name == ".zarray" || name == ".zgroup" || name == ".zattrs" ||
         name == ".zmetadata";
}

class AddressStore final : public ObjectStore {
 public:
  AddressStore(std::unique_ptr<ObjectStore> objects, std::string path, bool is_s3)
      : objects_(std::move(objects)),
        path_(std::move(path)),
        is_s3_(is_s3),
        kept_(KeptAnswers::OfThread()) {}

  [[nodiscard]] std::vector<absl::StatusOr<std::string>> Read(
      absl::Span<const ObjectRead> reads, const base::Cancellation& cancellation) const override {
    std::vector<absl::StatusOr<std::string>> answers =
        kept_ == nullptr ? Ask(reads, cancellation) : ReadOnce(reads, cancellation);
    const base::MutexLock lock(&mutex_);
    for (std::size_t i = 0; i < reads.size(); ++i) {
      if (IsZarrDocument(reads[i].key) && answers[i].ok()) {
        digests_[reads[i].key] = base::Sha256Hex(*answers[i]);
      }
    }
    for (std::size_t i = 0; i < reads.size(); ++i) {
      if (is_s3_ && IsZarrDocument(reads[i].key) && !digests_.empty() &&
          absl::IsPermissionDenied(answers[i].status())) {
        answers[i] = absl::NotFoundError(answers[i].status().message());
      }
    }
    return answers;
  }
  void Expect(absl::Span<const ObjectRead> reads) const override {
    if (kept_ != nullptr) {
      ReadOnce(reads, base::Cancellation());
    }
  }
  [[nodiscard]] absl::StatusOr<std::unique_ptr<ByteSource>> Open(
      const std::string& key, const base::Cancellation& cancellation) const override {
    return objects_->Open(key, cancellation);
  }
  [[nodiscard]] const std::string& name() const override { return path_; }

  // Of the documents that were read, by key.
  [[nodiscard]] std::map<std::string, std::string> digests() const {
    const base::MutexLock lock(&mutex_);
    return digests_;
  }

 private:
  // Asks the server.
  [[nodiscard]] std::vector<absl::StatusOr<std::string>> Ask(
      absl::Span<const ObjectRead> reads, const base::Cancellation& cancellation) const {
    base::Cancellation either(cancellation.deadline());
    const base::Cancellation::Callback by_caller(cancellation, [&either] { either.Cancel(); });
    const base::Cancellation::Callback by_process(base::ProcessInterrupt(),
                                                  [&either] { either.Cancel(); });
    std::vector<absl::StatusOr<std::string>> answers = objects_->Read(reads, either);
    AskAgain(reads, either, &answers);
    return answers;
  }
  // A chunk that is not there has the fill value, an array of Zarr 2 without .zattrs no scale and no
  // names. A server that says so by mistake would change the picture without a word: it is believed
  // if it says so twice.
  void AskAgain(absl::Span<const ObjectRead> reads, const base::Cancellation& cancellation,
                std::vector<absl::StatusOr<std::string>>* answers) const {
    std::set<std::string> nodes;  // of Zarr 2
    for (std::size_t i = 0; i < reads.size(); ++i) {
      const PathParts path = PartsOf(reads[i].key);
      if ((*answers)[i].ok() && (path.name == ".zarray" || path.name == ".zgroup")) {
        nodes.emplace(path.folder);
      }
    }
    const auto may_be_missing = [&nodes](const std::string& key) {
      const PathParts path = PartsOf(key);
      return IsZarrDocument(key) &&
             !(path.name == ".zattrs" && nodes.contains(std::string(path.folder)));
    };
    std::vector<ObjectRead> asked;
    std::vector<std::size_t> places;
    for (std::size_t i = 0; i < reads.size(); ++i) {
      if (absl::IsNotFound((*answers)[i].status()) && !may_be_missing(reads[i].key)) {
        asked.push_back(reads[i]);
        places.push_back(i);
      }
    }
    if (asked.empty()) {
      return;
    }
    std::vector<absl::StatusOr<std::string>> got = objects_->Read(asked, cancellation);
    for (std::size_t i = 0; i < asked.size(); ++i) {
      (*answers)[places[i]] = std::move(got[i]);
    }
  }
  // Asks for what the opening has not read yet.
  std::vector<absl::StatusOr<std::string>> ReadOnce(absl::Span<const ObjectRead> reads,
                                                    const base::Cancellation& cancellation) const {
    std::vector<absl::StatusOr<std::string>> answers(reads.size());
    std::vector<ObjectRead> asked;
    std::vector<std::size_t> places;
    for (std::size_t i = 0; i < reads.size(); ++i) {
      if (auto kept = kept_->Find(path_, reads[i]); kept.has_value()) {
        answers[i] = *std::move(kept);
      } else {
        asked.push_back(reads[i]);
        places.push_back(i);
      }
    }
    std::vector<absl::StatusOr<std::string>> got = Ask(asked, cancellation);
    for (std::size_t i = 0; i < asked.size(); ++i) {
      kept_->Keep(path_, asked[i], got[i],
                  IsZarrDocument(asked[i].key) ? kMaxKeptAnswerBytes : kMaxKeptObjectBytes);
      answers[places[i]] = std::move(got[i]);
    }
    return answers;
  }

  const std::unique_ptr<ObjectStore> objects_;
  const std::string path_;
  const bool is_s3_;
  const std::shared_ptr<KeptAnswers> kept_;  // of the opening that made it; null: none did
  mutable base::Mutex mutex_;
  mutable std::map<std::string, std::string> digests_ ABSL_GUARDED_BY(mutex_);
};

// The digest of a document, under its name: for stamps.
class DigestFile final : public io::RandomAccessFile {
 public:
  DigestFile(std::string path, std::string digest)
      : path_(std::move(path)), digest_(std::move(digest)) {}

  [[nodiscard]] absl::Status ReadAt(std::int64_t offset, std::size_t size,
                                    char* out) const override {
    ISOSCOPE_RETURN_IF_ERROR(io::CheckRange(*this, offset, size));
    digest_.copy(out, size, static_cast<std::size_t>(offset));
    return absl::OkStatus();
  }
  [[nodiscard]] std::int64_t size_bytes() const override {
    return static_cast<std::int64_t>(digest_.size());
  }
  [[nodiscard]] const std::string& path() const override { return path_; }

 private:
  const std::string path_;
  const std::string digest_;
};

// A store, as it is opened once more for each reader.
struct KnownStore {
  Address root;
  RemoteOptions options;
};

absl::StatusOr<std::shared_ptr<AddressStore>> OpenObjects(const KnownStore& known) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<ObjectStore> objects,
                            OpenAddressStore(RequestTextOf(known.root), known.options));
  return std::make_shared<AddressStore>(std::move(objects), PathOfAddress(known.root),
                                        known.root.is_s3);
}

// ---- What this process knows. -------------------------------------------------------------------

struct Found {
  absl::StatusOr<AddressSource> source = absl::UnknownError("");
  base::MonotonicTime at = {};
};

std::atomic<bool> refuses_other_hosts = false;

struct Known {
  base::Mutex mutex;
  std::map<std::string, Address> addresses ABSL_GUARDED_BY(mutex);  // by path
  std::map<std::string, KnownStore> stores ABSL_GUARDED_BY(mutex);  // by path of the root
  std::map<std::string, std::shared_ptr<const ByteSource>> objects ABSL_GUARDED_BY(mutex);

  base::Mutex finding;  // never held while a server is asked
  base::CondVar has_found;
  std::map<std::string, Found> found ABSL_GUARDED_BY(finding);  // by path
  std::set<std::string> in_search ABSL_GUARDED_BY(finding);     // paths that a thread asks for
};

Known& KnownOfProcess() {
  static auto* const known = new Known;
  return *known;
}

// Others may ask for the path once it goes out of scope, also by an exception.
class SearchEnd {
 public:
  explicit SearchEnd(const std::string& path) : path_(path) {}
  ~SearchEnd() {
    Known& known = KnownOfProcess();
    const base::MutexLock lock(&known.finding);
    known.in_search.erase(path_);
    known.has_found.SignalAll();
  }
  SearchEnd(const SearchEnd&) = delete;
  SearchEnd& operator=(const SearchEnd&) = delete;

 private:
  const std::string& path_;
};

// ---- Finding. -----------------------------------------------------------------------------------

// A file or a folder, and a part of it.
struct Candidate {
  std::string file;
  std::string part{};
};

// True if it ends as files of a format do.
bool HasFormatEnding(const std::string& path) {
  static constexpr absl::string_view kMore[] = {".h5",  ".hdf5", ".he5",    ".hdf", ".vtkhdf",
                                                ".ims", ".vti",  ".nrrd",   ".mha", ".mhd",
                                                ".nii", ".zip",  ".nii.gz", ".raw"};
  if (std::any_of(std::begin(kMore), std::end(kMore),
                  [&](absl::string_view ending) { return HasEnding(path, ending); })) {
    return true;
  }
  for (const Format& format : Formats()) {
    for (const std::string& ending : format.endings) {
      if (absl::StartsWith(ending, ".") && HasEnding(path, ending)) {
        return true;
      }
    }
  }
  return false;
}

// "a/run.zarr/0:x" is "a/run.zarr" and "0:x"; not set without ".zarr".
std::optional<Candidate> SplitAtZarr(const std::string& path) {
  const std::string ending = ".zarr";
  const std::string lower = absl::AsciiStrToLower(path);
  for (std::size_t at = lower.find(ending); at != std::string::npos;
       at = lower.find(ending, at + 1)) {
    const std::size_t end = at + ending.size();
    if (at > 0 && path[at - 1] != '/' &&
        (end == path.size() || path[end] == '/' || path[end] == ':')) {
      std::string part = path.substr(std::min(end + 1, path.size()));
      while (!part.empty() && part.back() == '/') {
        part.pop_back();
      }
      return Candidate{.file = path.substr(0, end), .part = std::move(part)};
    }
  }
  return std::nullopt;
}

std::vector<Candidate> CandidatesOf(const std::string& path) {
  std::vector<Candidate> candidates;
  const auto add = [&](std::size_t colon) {
    candidates.push_back({path.substr(0, colon), path.substr(colon + 1)});
  };
  for (std::size_t colon = path.find(':'); colon != std::string::npos;
       colon = path.find(':', colon + 1)) {
    if (HasFormatEnding(path.substr(0, colon))) {
      add(colon);
      return candidates;
    }
  }
  candidates.push_back({path});
  std::size_t colon = path.rfind(':');
  for (std::size_t i = 0; i < kMaxColons && colon != std::string::npos && colon > 1; ++i) {
    add(colon);
    colon = path.rfind(':', colon - 1);
  }
  return candidates;
}

// Errors after which something else may stand at the address.
bool MayBeOther(const absl::Status& status) {
  return absl::IsNotFound(status) || absl::IsPermissionDenied(status) ||
         absl::IsFailedPrecondition(status) || absl::IsInvalidArgument(status);
}

// part: of the store, whose metadata are fetched together with those of the root
absl::Status FindStore(const KnownStore& known, const std::string& part = "") {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<AddressStore> objects, OpenObjects(known));
  ZarrStore::ExpectRoot(*objects, part.substr(0, part.find(':')));
  return ZarrStore::Open(objects, nullptr).status();
}

absl::Status FindObject(const Address& address, const RemoteOptions& options) {
  ISOSCOPE_ASSIGN_OR_RETURN(StartedObject opened,
                            OpenAddressWithStart(RequestTextOf(address), options, kCachedBlockBytes,
                                                 base::ProcessInterrupt()));
  const std::shared_ptr<const ByteSource> bytes = std::move(opened.bytes);
  const std::string path = PathOfAddress(address);
  const std::string version = bytes->version();
  io::MountedFile file{.file = MakeCachedFile(bytes, path, std::move(opened.start)),
                       .version = absl::StrCat(version, DigestOf(address.query)),
                       .tells_all = !version.empty(),
                       .read_pieces = [bytes](absl::Span<const io::FilePiece> pieces,
                                              const base::Cancellation& cancellation) {
                         std::vector<ByteRange> ranges;
                         for (const io::FilePiece& piece : pieces) {
                           ranges.push_back({piece.range.offset, piece.range.size, piece.out});
                         }
                         return bytes->ReadRanges(ranges, cancellation);
                       }};
  Known& known = KnownOfProcess();
  const base::MutexLock lock(&known.mutex);  // both are of one request
  io::MountFile(std::move(file));
  known.objects[path] = bytes;
  return absl::OkStatus();
}

// What stands at the address, as a whole.
absl::StatusOr<AddressSource> FindWhole(const Address& address, const RemoteOptions& options) {
  const std::string& object_path = ObjectPathOf(address);
  const std::string name = object_path.substr(object_path.rfind('/') + 1);
  const bool is_store_first = !absl::StrContains(name, '.');
  KnownStore store{.root = address, .options = options};
  while (absl::EndsWith(ObjectPathOf(store.root), "/") && ObjectPathOf(store.root).size() > 1) {
    store.root = WithObjectPath(
        store.root, ObjectPathOf(store.root).substr(0, ObjectPathOf(store.root).size() - 1));
  }
  absl::Status first_error;
  for (const bool is_store : {is_store_first, !is_store_first}) {
    if (!is_store && name.empty()) {
      continue;  // a folder
    }
    const absl::Status status = is_store ? FindStore(store) : FindObject(address, options);
    if (status.ok()) {
      AddressSource found{.file = PathOfAddress(is_store ? store.root : address),
                          .is_store = is_store};
      if (is_store) {
        Known& known = KnownOfProcess();
        const base::MutexLock lock(&known.mutex);
        known.stores[found.file] = std::move(store);
      }
      return found;
    }
    if (!MayBeOther(status)) {
      return status;
    }
    // That no store is there says less than what became of the object.
    if (first_error.ok() || !is_store) {
      first_error = status;
    }
  }
  return absl::IsNotFound(first_error)
             ? absl::NotFoundError(absl::StrCat(
                   PathOfAddress(address),
                   ": neither an object nor a Zarr store is there: ", first_error.message()))
             : first_error;
}

absl::StatusOr<AddressSource> FindFirst(const Address& address) {
  absl::StatusOr<RemoteOptions> from_environment = RemoteOptionsFromEnvironment();
  if (!from_environment.ok()) {  // says nothing of the object
    return absl::FailedPreconditionError(from_environment.status().message());
  }
  RemoteOptions options = *std::move(from_environment);
  options.follows_to_other_hosts = options.follows_to_other_hosts && !refuses_other_hosts;
  const std::string& path = ObjectPathOf(address);
  if (address.is_s3 && path.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat(PathOfAddress(address), ": names a bucket; expected s3://BUCKET/KEY"));
  }
  // 1. A store.
  if (std::optional<Candidate> zarr = SplitAtZarr(path); zarr.has_value()) {
    KnownStore store{.root = WithObjectPath(address, zarr->file), .options = options};
    const absl::Status status = FindStore(store, zarr->part);
    if (status.ok() || !MayBeOther(status) || zarr->part.empty()) {
      ISOSCOPE_RETURN_IF_ERROR(status);
      AddressSource found{.file = PathOfAddress(store.root), .part = zarr->part, .is_store = true};
      Known& known = KnownOfProcess();
      const base::MutexLock lock(&known.mutex);
      known.stores[found.file] = std::move(store);
      return found;
    }
  }
  // 2. Candidates.
  absl::Status first_error;
  for (const Candidate& candidate : CandidatesOf(path)) {
    absl::StatusOr<AddressSource> found =
        FindWhole(WithObjectPath(address, candidate.file), options);
    if (found.ok()) {
      found->part = candidate.part;
      return found;
    }
    if (!MayBeOther(found.status())) {
      return found;
    }
    first_error = first_error.ok() ? found.status() : first_error;
  }
  return first_error;
}

}  // namespace

absl::StatusOr<std::string> PathOfSource(absl::string_view text) {
  if (!io::IsAddressText(text)) {
    return std::string(text);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const Address address, ParseAddress(text));
  std::string path = PathOfAddress(address);
  Known& known = KnownOfProcess();
  const base::MutexLock lock(&known.mutex);
  const auto found = known.addresses.find(path);
  if (found != known.addresses.end()) {
    // The path itself is what an earlier call returned.
    return found->second == address || address.query.empty()
               ? absl::StatusOr<std::string>(std::move(path))
               : absl::InvalidArgumentError(absl::StrCat(
                     path, ": was given with another query before; expected one address of it"));
  }
  if (known.addresses.size() >= kMaxPaths) {
    return absl::ResourceExhaustedError(
        absl::StrCat(path, ": more than ", kMaxPaths, " addresses in one process"));
  }
  known.addresses.emplace(path, address);
  return path;
}

absl::StatusOr<AddressSource> FindAtAddress(const std::string& path) {
  Known& known = KnownOfProcess();
  Address address;
  {
    const base::MutexLock lock(&known.mutex);
    const auto found = known.addresses.find(path);
    if (found == known.addresses.end()) {
      return absl::InternalError(absl::StrCat(path, ": no path of PathOfSource"));
    }
    address = found->second;
  }
  // A path that another thread asks for is waited for, and no other.
  std::optional<absl::StatusOr<AddressSource>> answer;
  ISOSCOPE_RETURN_IF_ERROR(base::AwaitOrCancelled(
      base::ProcessInterrupt(), &known.finding, &known.has_found,
      [&]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(known.finding) {
        const auto found = known.found.find(path);
        if (found != known.found.end() &&
            (found->second.source.ok() || base::MonotonicNow() - found->second.at < kErrorLife)) {
          answer = found->second.source;
          return true;
        }
        return known.in_search.insert(path).second;
      }));
  if (answer.has_value()) {
    return *std::move(answer);
  }
  const SearchEnd search_end(path);
  absl::StatusOr<AddressSource> source = FindFirst(address);
  if (!source.ok() && !base::ProcessInterrupt().Check().ok()) {
    return source;  // says nothing of the source: others go on
  }
  const base::MutexLock lock(&known.finding);
  known.found[path] = {.source = source, .at = base::MonotonicNow()};
  return source;
}

absl::StatusOr<std::unique_ptr<ZarrStore>> OpenZarrAtAddress(const std::string& file) {
  Known& known = KnownOfProcess();
  std::optional<KnownStore> store;
  std::shared_ptr<const ByteSource> bytes;
  {
    const base::MutexLock lock(&known.mutex);
    if (const auto found = known.stores.find(file); found != known.stores.end()) {
      store = found->second;
    } else if (const auto object = known.objects.find(file); object != known.objects.end()) {
      bytes = object->second;
    }
  }
  if (bytes != nullptr) {
    return OpenZippedZarr(std::move(bytes));
  }
  if (!store.has_value()) {
    return absl::InternalError(absl::StrCat(file, ": nothing was found there"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<AddressStore> objects, OpenObjects(*store));
  return ZarrStore::Open(objects, nullptr);
}

absl::StatusOr<std::vector<std::string>> FilesOfZarrAtAddress(const std::string& file,
                                                              const std::string& part,
                                                              const std::string& axes,
                                                              const GridRules& rules) {
  if (io::IsMounted(file)) {
    return std::vector<std::string>{file};
  }
  Known& known = KnownOfProcess();
  std::optional<KnownStore> store;
  {
    const base::MutexLock lock(&known.mutex);
    if (const auto found = known.stores.find(file); found != known.stores.end()) {
      store = found->second;
    }
  }
  if (!store.has_value()) {
    return absl::InternalError(absl::StrCat(file, ": nothing was found there"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<AddressStore> objects, OpenObjects(*store));
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<ZarrStore> zarr, ZarrStore::Open(objects, nullptr));
  ISOSCOPE_RETURN_IF_ERROR(OpenZarrSeries(std::move(zarr), part, axes, rules).status());
  std::vector<std::string> files;
  const std::string query = DigestOf(store->root.query);
  for (const auto& [key, digest] : objects->digests()) {
    files.push_back(absl::StrCat(file, "/", key));
    io::MountFile({.file = std::make_shared<DigestFile>(files.back(), digest),
                   .version = absl::StrCat(digest, query),
                   .tells_all = false});
  }
  return files;
}

void ForgetAddress(absl::string_view text) {
  const absl::StatusOr<std::string> path = PathOfSource(text);
  if (path.ok()) {
    Known& known = KnownOfProcess();
    const base::MutexLock lock(&known.finding);
    known.found.erase(*path);
  }
}

void RefuseOtherHosts() { refuses_other_hosts = true; }

absl::Status NeedsWholeFile(const std::string& path, absl::string_view what) {
  return absl::InvalidArgumentError(absl::StrCat(path, ": ", what,
                                                 " at an address needs the whole file; bring it "
                                                 "with: isoscope copy ",
                                                 path));
}

}  // namespace isoscope::source
