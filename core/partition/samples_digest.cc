#include "core/partition/samples_digest.h"

#include <cstddef>

#include <openssl/evp.h>

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/sha256.h"

namespace isoscope::partition {
namespace {

constexpr std::size_t kSha256Bytes = 32;
constexpr std::size_t kDigestDigits = 32;
constexpr absl::string_view kPrefix("isoscope samples 1\0", 19);

using Sha256 = std::array<unsigned char, kSha256Bytes>;

// Adding 0 turns -0 into 0, which is the same position.
void AppendVector(const math::Vec3d& vector, std::string* out) {
  base::AppendLittleEndian(vector.x + 0.0, out);
  base::AppendLittleEndian(vector.y + 0.0, out);
  base::AppendLittleEndian(vector.z + 0.0, out);
}

}  // namespace

DigestSum SumOf(const DigestSum& a, const DigestSum& b) {
  DigestSum sum{};
  std::uint64_t carry = 0;
  for (std::size_t i = 0; i < sum.size(); ++i) {
    const std::uint64_t with_carry = a[i] + carry;
    carry = with_carry < carry ? 1 : 0;
    sum[i] = with_carry + b[i];
    carry += static_cast<std::uint64_t>(sum[i] < with_carry);
  }
  return sum;
}

// Kept between rows, because making it costs more than hashing a row.
struct SamplesDigest::Hash {
  Hash() { ISOSCOPE_CHECK(context != nullptr && algorithm != nullptr); }
  ~Hash() {
    EVP_MD_CTX_free(context);
    EVP_MD_free(algorithm);
  }
  Hash(const Hash&) = delete;
  Hash& operator=(const Hash&) = delete;

  [[nodiscard]] Sha256 Of(absl::string_view head, absl::string_view body) const {
    Sha256 digest;
    ISOSCOPE_CHECK(EVP_DigestInit_ex(context, algorithm, nullptr) == 1 &&
                   EVP_DigestUpdate(context, head.data(), head.size()) == 1 &&
                   EVP_DigestUpdate(context, body.data(), body.size()) == 1 &&
                   EVP_DigestFinal_ex(context, digest.data(), nullptr) == 1);
    return digest;
  }

  EVP_MD_CTX* const context = EVP_MD_CTX_new();
  EVP_MD* const algorithm = EVP_MD_fetch(nullptr, "SHA256", nullptr);
};

SamplesDigest::SamplesDigest() = default;
SamplesDigest::~SamplesDigest() = default;

void SamplesDigest::AddRow(std::int64_t y, std::int64_t z, absl::string_view samples) {
  if (hash_ == nullptr) {
    hash_ = std::make_unique<Hash>();
  }
  std::array<char, 2 * sizeof(std::int64_t)> position{};
  base::StoreLittleEndian(y, position.data());
  base::StoreLittleEndian(z, position.data() + sizeof(y));
  const Sha256 digest = hash_->Of({position.data(), position.size()}, samples);
  SamplesDigest row;
  for (std::size_t i = 0; i < row.sum_.size(); ++i) {
    row.sum_[i] = base::LoadLittleEndian<std::uint64_t>(digest.data() + i * sizeof(std::uint64_t));
  }
  Add(row);
}

void SamplesDigest::Add(const SamplesDigest& other) { sum_ = SumOf(sum_, other.sum_); }

std::string SamplesDigest::Finish(const volume::GridGeometry& geometry,
                                  volume::ScalarType type) const {
  std::string canonical(kPrefix);
  base::AppendLittleEndian(geometry.sample_dims.x, &canonical);
  base::AppendLittleEndian(geometry.sample_dims.y, &canonical);
  base::AppendLittleEndian(geometry.sample_dims.z, &canonical);
  AppendVector(geometry.spacing, &canonical);
  AppendVector(geometry.origin, &canonical);
  for (const math::Vec3d& column : geometry.direction.columns) {
    AppendVector(column, &canonical);
  }
  base::AppendLittleEndian(static_cast<std::uint32_t>(type), &canonical);
  for (const std::uint64_t word : sum_) {
    base::AppendLittleEndian(word, &canonical);
  }
  return base::Sha256Hex(canonical).substr(0, kDigestDigits);
}

}  // namespace isoscope::partition
