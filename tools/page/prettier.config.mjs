/** As the Python code: 88 columns. */
export default { printWidth: 88 };
