"""Certificates and private keys of OPC UA, read from files in PEM or DER; each error message is one line."""

from __future__ import annotations

from pathlib import Path

from asyncua.crypto.uacrypto import CertProperties
from cryptography import x509
from cryptography.hazmat.primitives import serialization

PEM = b"-----BEGIN"


def certificate_in(file: Path) -> tuple[CertProperties, str]:
    """Read an OPC UA certificate from a file; returns it with its application URI, empty without one.

    Servers compare the application URI with that of the client.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file has no certificate; one line.
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
        raise ValueError(
            f"certificate: given {file.name}, in which there is none; allowed: a certificate in PEM or DER"
        ) from None
    return CertProperties(content, "pem" if is_pem else "der"), next(iter(uris), "")


def key_in(file: Path, password: str | None = None) -> CertProperties:
    """Read an OPC UA private key from a file.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file has no key, or the password is not that of the key; one line.
    """
    content = file.read_bytes()
    is_pem, secret = PEM in content, None if password is None else password.encode()
    load = serialization.load_pem_private_key if is_pem else serialization.load_der_private_key
    try:
        load(content, password=secret)
    except (TypeError, ValueError):  # TypeError: a password too many, or none
        reason = "a private key in PEM or DER, with its password"
        raise ValueError(f"private_key: given {file.name}; allowed: {reason}") from None
    return CertProperties(content, "pem" if is_pem else "der", secret)
