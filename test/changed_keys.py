"""Plain data of a scenario with some of its values changed."""


def change(data, changes):
    """Put values at keys joined by two underscores into `data`, and give it back."""
    for key, value in changes.items():
        *path, last = key.split("__")
        section = data
        for name in path:
            section = section[name]
        section[last] = value
    return data
