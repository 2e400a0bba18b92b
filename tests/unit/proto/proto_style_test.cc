// The style of our protos, checked on the descriptor set that protoc writes (proto/README.md has
// the rules). Every failure names the element and what to do.

#include <fstream>
#include <functional>
#include <set>
#include <string>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "google/protobuf/descriptor.h"
#include "google/protobuf/descriptor.pb.h"
#include "gtest/gtest.h"

namespace isoscope {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::DescriptorPool;
using google::protobuf::EnumDescriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::FileDescriptor;
using google::protobuf::MethodDescriptor;
using google::protobuf::ServiceDescriptor;
using google::protobuf::SourceLocation;

// "SampleType" -> "SAMPLE_TYPE".
std::string ToUpperSnake(const std::string& camel) {
  std::string snake;
  for (std::size_t i = 0; i < camel.size(); ++i) {
    if (i > 0 && absl::ascii_isupper(static_cast<unsigned char>(camel[i]))) {
      snake += '_';
    }
    snake += absl::ascii_toupper(static_cast<unsigned char>(camel[i]));
  }
  return snake;
}

class ProtoStyleTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::ifstream in(ISOSCOPE_DESCRIPTOR_SET, std::ios::binary);
    google::protobuf::FileDescriptorSet set;
    ASSERT_TRUE(set.ParseFromIstream(&in)) << ISOSCOPE_DESCRIPTOR_SET;
    for (const auto& file : set.file()) {
      const FileDescriptor* built = pool_.BuildFile(file);
      ASSERT_NE(built, nullptr) << file.name();
      if (absl::StartsWith(built->package(), "isoscope.")) {
        files_.push_back(built);
      }
    }
    ASSERT_GE(files_.size(), 7u);
  }

  void ForEachMessage(const std::function<void(const Descriptor*)>& visit) const {
    const std::function<void(const Descriptor*)> walk = [&](const Descriptor* message) {
      visit(message);
      for (int i = 0; i < message->nested_type_count(); ++i) {
        walk(message->nested_type(i));
      }
    };
    for (const FileDescriptor* file : files_) {
      for (int i = 0; i < file->message_type_count(); ++i) {
        walk(file->message_type(i));
      }
    }
  }

  void ForEachField(const std::function<void(const FieldDescriptor*)>& visit) const {
    ForEachMessage([&](const Descriptor* message) {
      for (int i = 0; i < message->field_count(); ++i) {
        visit(message->field(i));
      }
    });
  }

  void ForEachEnum(const std::function<void(const EnumDescriptor*)>& visit) const {
    for (const FileDescriptor* file : files_) {
      for (int i = 0; i < file->enum_type_count(); ++i) {
        visit(file->enum_type(i));
      }
    }
    ForEachMessage([&](const Descriptor* message) {
      for (int i = 0; i < message->enum_type_count(); ++i) {
        visit(message->enum_type(i));
      }
    });
  }

  void ForEachService(const std::function<void(const ServiceDescriptor*)>& visit) const {
    for (const FileDescriptor* file : files_) {
      for (int i = 0; i < file->service_count(); ++i) {
        visit(file->service(i));
      }
    }
  }

  void ForEachMethod(const std::function<void(const MethodDescriptor*)>& visit) const {
    ForEachService([&](const ServiceDescriptor* service) {
      for (int i = 0; i < service->method_count(); ++i) {
        visit(service->method(i));
      }
    });
  }

  template <typename T>
  static void ExpectComment(const T* element) {
    SourceLocation location;
    ASSERT_TRUE(element->GetSourceLocation(&location)) << element->full_name();
    EXPECT_FALSE(absl::StripAsciiWhitespace(location.leading_comments).empty())
        << element->full_name() << " has no comment: write one above it";
  }

  DescriptorPool pool_;
  std::vector<const FileDescriptor*> files_;
};

TEST_F(ProtoStyleTest, PackagesMatchFoldersAndEndInAVersion) {
  for (const FileDescriptor* file : files_) {
    const std::string folder = file->name().substr(0, file->name().rfind('/'));
    EXPECT_EQ(absl::StrReplaceAll(folder, {{"/", "."}}), file->package()) << file->name();
    const std::vector<std::string> parts = absl::StrSplit(file->package(), '.');
    EXPECT_EQ(parts.back()[0], 'v') << file->package();
    EXPECT_EQ(absl::AsciiStrToLower(file->name()), file->name());
  }
}

TEST_F(ProtoStyleTest, PublicFilesDoNotImportInternalOnes) {
  for (const FileDescriptor* file : files_) {
    if (absl::StrContains(file->package(), ".internal.")) {
      continue;
    }
    for (int i = 0; i < file->dependency_count(); ++i) {
      EXPECT_FALSE(absl::StrContains(file->dependency(i)->package(), ".internal."))
          << file->name() << " imports " << file->dependency(i)->name();
    }
  }
}

TEST_F(ProtoStyleTest, EnumsBeginWithUnspecifiedAndPrefixTheirValues) {
  ForEachEnum([](const EnumDescriptor* type) {
    const std::string prefix = ToUpperSnake(type->name()) + "_";
    EXPECT_EQ(type->value(0)->name(), prefix + "UNSPECIFIED") << type->full_name();
    EXPECT_EQ(type->value(0)->number(), 0) << type->full_name();
    for (int i = 0; i < type->value_count(); ++i) {
      EXPECT_TRUE(absl::StartsWith(type->value(i)->name(), prefix)) << type->value(i)->full_name();
    }
  });
}

TEST_F(ProtoStyleTest, ServicesEndInServiceAndMethodsHaveTheirOwnMessages) {
  std::set<std::string> used;
  ForEachService([](const ServiceDescriptor* service) {
    EXPECT_TRUE(absl::EndsWith(service->name(), "Service")) << service->full_name();
  });
  ForEachMethod([&](const MethodDescriptor* method) {
    EXPECT_EQ(method->input_type()->name(), method->name() + "Request") << method->full_name();
    EXPECT_EQ(method->output_type()->name(), method->name() + "Response") << method->full_name();
    EXPECT_TRUE(used.insert(method->input_type()->full_name()).second) << method->full_name();
    EXPECT_TRUE(used.insert(method->output_type()->full_name()).second) << method->full_name();
  });
}

TEST_F(ProtoStyleTest, EverythingHasAComment) {
  ForEachService([](const ServiceDescriptor* service) { ExpectComment(service); });
  ForEachMethod([](const MethodDescriptor* method) { ExpectComment(method); });
  ForEachMessage([](const Descriptor* message) {
    ExpectComment(message);
    for (int i = 0; i < message->real_oneof_decl_count(); ++i) {
      ExpectComment(message->oneof_decl(i));
    }
  });
  ForEachField([](const FieldDescriptor* field) { ExpectComment(field); });
  ForEachEnum([](const EnumDescriptor* type) {
    ExpectComment(type);
    for (int i = 0; i < type->value_count(); ++i) {
      ExpectComment(type->value(i));
    }
  });
}

TEST_F(ProtoStyleTest, MethodsSayWhichErrorsThereAre) {
  ForEachMethod([](const MethodDescriptor* method) {
    SourceLocation location;
    ASSERT_TRUE(method->GetSourceLocation(&location));
    EXPECT_TRUE(absl::StrContains(location.leading_comments, "Errors"))
        << method->full_name() << ": add \"Errors:\" and the codes to its comment";
  });
}

TEST_F(ProtoStyleTest, FieldsCarryUnitsInTheirNames) {
  ForEachField([](const FieldDescriptor* field) {
    const std::string& name = field->name();
    EXPECT_EQ(absl::AsciiStrToLower(name), name) << field->full_name();
    EXPECT_FALSE(absl::StartsWith(name, "num_") || absl::StartsWith(name, "n_"))
        << field->full_name() << ": counts end in _count";
    // A field that is no number has no unit.
    const bool is_bytes = field->type() == FieldDescriptor::TYPE_BYTES;
    for (const char* abbreviated : {"_ms", "_sec", "_secs", "_deg", "_pixels", "_size", "_kb"}) {
      // "page_size" is what lists with pages call it everywhere.
      EXPECT_FALSE(!is_bytes && name != "page_size" && absl::EndsWith(name, abbreviated))
          << field->full_name() << ": use _duration, _degrees, _px or _bytes";
    }
    const bool is_duration = field->type() == FieldDescriptor::TYPE_MESSAGE &&
                             field->message_type()->full_name() == "google.protobuf.Duration";
    EXPECT_EQ(is_duration, absl::EndsWith(name, "_duration")) << field->full_name();
    // A switch of what an answer has, as with_unresolved_count, is no count.
    const bool is_switch =
        absl::StartsWith(name, "with_") && field->type() == FieldDescriptor::TYPE_BOOL;
    // A distance on the screen may have a fraction.
    const bool is_distance =
        absl::EndsWith(name, "_px") && field->type() == FieldDescriptor::TYPE_DOUBLE;
    if (!is_switch && !is_distance &&
        (absl::EndsWith(name, "_count") || absl::EndsWith(name, "_bytes") ||
         absl::EndsWith(name, "_px"))) {
      EXPECT_TRUE(field->type() == FieldDescriptor::TYPE_INT64 ||
                  field->type() == FieldDescriptor::TYPE_INT32)
          << field->full_name() << ": must be a signed integer";
    }
  });
}

TEST_F(ProtoStyleTest, IntegersAreSignedExceptChecksums) {
  ForEachField([](const FieldDescriptor* field) {
    const bool is_unsigned = field->type() == FieldDescriptor::TYPE_UINT32 ||
                             field->type() == FieldDescriptor::TYPE_UINT64 ||
                             field->type() == FieldDescriptor::TYPE_FIXED32 ||
                             field->type() == FieldDescriptor::TYPE_FIXED64;
    EXPECT_EQ(is_unsigned, absl::EndsWith(field->name(), "crc32c")) << field->full_name();
  });
}

}  // namespace
}  // namespace isoscope
