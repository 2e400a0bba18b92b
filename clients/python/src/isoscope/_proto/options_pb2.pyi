from google.protobuf import descriptor_pb2 as _descriptor_pb2
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Optional as _Optional

DESCRIPTOR: _descriptor.FileDescriptor
EFFECT_OPTIONS_FIELD_NUMBER: _ClassVar[int]
FIRST_LOOK_FIELD_NUMBER: _ClassVar[int]
VALUE_OPTIONS_FIELD_NUMBER: _ClassVar[int]
effect_options: _descriptor.FieldDescriptor
first_look: _descriptor.FieldDescriptor
value_options: _descriptor.FieldDescriptor

class EffectOptions(_message.Message):
    __slots__ = ["help", "title"]
    HELP_FIELD_NUMBER: _ClassVar[int]
    TITLE_FIELD_NUMBER: _ClassVar[int]
    help: str
    title: str
    def __init__(self, title: _Optional[str] = ..., help: _Optional[str] = ...) -> None: ...

class FirstLook(_message.Message):
    __slots__ = ["azimuth_degrees", "diffuse", "elevation_degrees", "samples", "shininess", "specular"]
    AZIMUTH_DEGREES_FIELD_NUMBER: _ClassVar[int]
    DIFFUSE_FIELD_NUMBER: _ClassVar[int]
    ELEVATION_DEGREES_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_FIELD_NUMBER: _ClassVar[int]
    SHININESS_FIELD_NUMBER: _ClassVar[int]
    SPECULAR_FIELD_NUMBER: _ClassVar[int]
    azimuth_degrees: float
    diffuse: float
    elevation_degrees: float
    samples: int
    shininess: float
    specular: float
    def __init__(self, azimuth_degrees: _Optional[float] = ..., elevation_degrees: _Optional[float] = ..., samples: _Optional[int] = ..., diffuse: _Optional[float] = ..., specular: _Optional[float] = ..., shininess: _Optional[float] = ...) -> None: ...

class ValueOptions(_message.Message):
    __slots__ = ["default_text", "help", "max", "min"]
    DEFAULT_TEXT_FIELD_NUMBER: _ClassVar[int]
    HELP_FIELD_NUMBER: _ClassVar[int]
    MAX_FIELD_NUMBER: _ClassVar[int]
    MIN_FIELD_NUMBER: _ClassVar[int]
    default_text: str
    help: str
    max: float
    min: float
    def __init__(self, min: _Optional[float] = ..., max: _Optional[float] = ..., default_text: _Optional[str] = ..., help: _Optional[str] = ...) -> None: ...
