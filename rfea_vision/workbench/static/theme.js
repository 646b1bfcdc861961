// Before the first paint: dark or light, as chosen here before or as the system has it. The report keeps the same choice.
try { document.documentElement.dataset.theme = localStorage.getItem("rfea-theme") || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"); } catch { /* storage may be closed */ }
