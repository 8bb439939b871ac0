"""Certificates and private keys of OPC UA from files, in PEM or DER by their content, with faults in one line."""

from __future__ import annotations

from pathlib import Path

from asyncua.crypto.uacrypto import CertProperties
from cryptography import x509
from cryptography.hazmat.primitives import serialization

PEM = b"-----BEGIN"


def certificate_in(file: Path) -> tuple[CertProperties, str]:
    """Certificate in a file, and its application URI, which servers compare with that of the client; empty without.

    Raises:
        OSError: the file cannot be read.
        ValueError: it has no certificate; one line.
    """
    content = file.read_bytes()
    is_pem = PEM in content
    try:
        found = x509.load_pem_x509_certificate(content) if is_pem else x509.load_der_x509_certificate(content)
        names = found.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        uris = names.get_values_for_type(x509.UniformResourceIdentifier)
    except x509.ExtensionNotFound:
        uris = []
    except ValueError:
        raise ValueError(f"{file.name} is no certificate in PEM or DER") from None
    return CertProperties(content, "pem" if is_pem else "der"), next(iter(uris), "")


def key_in(file: Path, password: str | None = None) -> CertProperties:
    """Private key in a file.

    Raises:
        OSError: the file cannot be read.
        ValueError: it has no key, or the password is not that of the key; one line.
    """
    content = file.read_bytes()
    is_pem, secret = PEM in content, None if password is None else password.encode()
    load = serialization.load_pem_private_key if is_pem else serialization.load_der_private_key
    try:
        load(content, password=secret)
    except (TypeError, ValueError):  # TypeError: a password too many, or none
        reason = "the password is not that of the key, or it is no private key in PEM or DER"
        raise ValueError(f"{file.name}: {reason}") from None
    return CertProperties(content, "pem" if is_pem else "der", secret)
