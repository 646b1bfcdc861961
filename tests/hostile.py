"""Names that are markup, scripts, templates or comments: whoever shows them must show them, and nothing else."""

PAYLOADS = (
    "<script>window.done=1</script>", "<img src=x onerror='window.done=1'>", "<svg onload=window.done=1>", "\"><b onclick=1>",
    "javascript:window.done=1", "{{7*7}}", "${window.done=1}", "<iframe srcdoc='<script>parent.done=1</script>'>", "'-alert(1)-'",
    "</script><script>window.done=1</script>", "<math><mtext><img src=x onerror=window.done=1>", "\u202egnp.exe",
    "<a href=//evil.example>x", "*/ int evil; /*", "*\\\n/ int evil; /*", "\x1b[2J\x00\x07", "]]><script>window.done=1</script>",
)  # fmt: skip
HOSTILE = [f"{payload} {number}" for number, payload in enumerate(PAYLOADS * 4)][:50]
